# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `bag_player` as a process of its own: what was recorded comes, when it should."""

from importlib.util import find_spec
import time

from mcap.writer import Writer as McapWriter
import pytest

pytest.importorskip('rclpy')

from forked_nodes import fork
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from ros_support import GRAPH, PATIENCE, Tester
from rosgraph_msgs.msg import Clock

from gip_localizer.core.pose import Pose2
from gip_localizer.io.bags.writer import BagWriter, make, make_header, make_pose
from gip_localizer.io.messages import planar_pose, stamp_ns
from gip_localizer.ros.conversions import header_of, time_of
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros

SECOND = 1_000_000_000
START = 1_600_000_000 * SECOND
KIND = 'geometry_msgs/msg/PoseStamped'
STAMPS = [START + k * SECOND // 5 for k in range(6)]


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / 'bag'
    with BagWriter(path, {'/pose': KIND, '/other': KIND}) as writer:
        for index, stamp in enumerate(STAMPS):
            pose = make_pose(Pose2(float(index), -1.0, 0.5))
            message = make(KIND, header=make_header(stamp, 'map'), pose=pose)
            writer.write('/pose', stamp, message)
            writer.write('/other', stamp, message)
    return path


@pytest.fixture
def tester():
    node = Tester()
    yield node
    node.close()


@pytest.fixture
def nodes(tmp_path):
    with NodeProcesses(tmp_path, GRAPH, fork) as processes:
        yield processes


def play(tester, nodes, bag, **settings):
    """Start paused, let go when the listener is known; return the process and the clocks."""
    clocks = []
    tester.create_subscription(Clock, '/clock', clocks.append, 1000)
    process = nodes.start('bag_player', {'bag': str(bag), 'paused': True, **settings})
    tester.until(lambda: tester.count_publishers('pose'), 'the player', alive=process)
    if find_spec('rosbag2_interfaces'):
        from rosbag2_interfaces.srv import Resume

        tester.ask(Resume, '/bag_player/resume', Resume.Request())
    else:
        assert tester.switch('/bag_player/pause', False).message == 'playing'
    return process, clocks


def test_every_message_comes_in_order_and_in_the_time_of_the_bag(tester, nodes, bag):
    process, clocks = play(tester, nodes, bag)
    began = time.monotonic()
    tester.until(lambda: len(tester.poses) == len(STAMPS), 'all poses')
    elapsed = time.monotonic() - began
    assert [stamp_ns(message.header) for message in tester.poses] == STAMPS
    assert planar_pose(tester.poses[3].pose) == pytest.approx((3.0, -1.0, 0.5))
    # A bag of one second cannot have been played in half of it, however busy the machine.
    assert elapsed > 0.5
    assert process.wait(PATIENCE) == 0
    times = [clock.clock.sec * SECOND + clock.clock.nanosec for clock in clocks]
    assert times == sorted(times)
    assert times[0] >= START
    assert times[-1] <= STAMPS[-1] + SECOND


def test_start_rate_and_topics_are_obeyed(tester, nodes, bag):
    process, _ = play(tester, nodes, bag, start=0.5, rate=4.0, topics='/pose')
    tester.until(lambda: len(tester.poses) == 3, 'the later half')
    assert [stamp_ns(message.header) for message in tester.poses] == STAMPS[3:]
    assert process.wait(PATIENCE) == 0


def test_pause_step_and_seek(tester, nodes, bag):
    if find_spec('rosbag2_interfaces'):
        pytest.skip('the services are those of rosbag2: see the next test')
    process = nodes.start('bag_player', {'bag': str(bag), 'paused': True, 'topics': '/pose'})
    tester.until(lambda: tester.count_publishers('pose'), 'the player', alive=process)
    for count in (1, 2):
        assert tester.trigger('/bag_player/play_next').success
        tester.until(lambda count=count: len(tester.poses) == count, 'a step')
    assert [stamp_ns(message.header) for message in tester.poses] == STAMPS[:2]
    assert tester.set('start', 0.7, node='bag_player').successful
    assert tester.trigger('/bag_player/play_next').success
    tester.until(lambda: len(tester.poses) == 3, 'the message after the seek')
    assert stamp_ns(tester.poses[-1].header) == STAMPS[4]
    assert tester.set('start', 0.0, node='bag_player').successful
    assert tester.trigger('/bag_player/toggle_paused').message == 'playing'
    refused = tester.trigger('/bag_player/play_next')
    assert not refused.success
    assert 'only while paused' in refused.message
    tester.until(lambda: len(tester.poses) == 3 + len(STAMPS), 'all from the beginning')
    assert process.wait(PATIENCE) == 0


def test_the_services_of_rosbag2_where_their_types_are_installed(tester, nodes, bag):
    srv = pytest.importorskip('rosbag2_interfaces.srv', reason='not in the wheels')
    process = nodes.start('bag_player', {'bag': str(bag), 'paused': True, 'topics': '/pose'})
    tester.until(lambda: tester.count_publishers('pose'), 'the player', alive=process)

    def call(name, service, **fields):
        kind = getattr(srv, name)
        return tester.ask(kind, f'/bag_player/{service}', kind.Request(**fields))

    assert call('IsPaused', 'is_paused').paused
    assert call('PlayNext', 'play_next').success
    assert call('Seek', 'seek', time=time_of(STAMPS[4])).success
    assert not call('Seek', 'seek', time=time_of(STAMPS[0] - SECOND)).success
    assert call('PlayNext', 'play_next').success
    tester.until(lambda: len(tester.poses) == 2, 'both steps')
    assert [stamp_ns(message.header) for message in tester.poses] == [STAMPS[0], STAMPS[4]]
    assert call('SetRate', 'set_rate', rate=2.0).success
    assert not call('SetRate', 'set_rate', rate=-1.0).success
    assert call('GetRate', 'get_rate').rate == 2.0
    call('Pause', 'pause')
    assert call('IsPaused', 'is_paused').paused
    call('TogglePaused', 'toggle_paused')
    assert process.wait(PATIENCE) == 0


def test_the_recorded_quality_of_service_is_offered(tester, nodes, tmp_path):
    """Two topics, best effort and latched; the latter was recorded before the start."""
    path = tmp_path / 'offered.mcap'
    with path.open('wb') as stream:
        writer = McapWriter(stream)
        writer.start(profile='ros2', library='test')
        schema = writer.register_schema(KIND, 'ros2msg', b'# as the recorder knew it')
        for topic, offered, stamps in (
            ('/pose', '- {reliability: best_effort, durability: volatile, depth: 5}', STAMPS),
            ('/goal', '- {reliability: reliable, durability: transient_local}', STAMPS[:1]),
        ):
            channel = writer.register_channel(topic, 'cdr', schema,
                                              {'offered_qos_profiles': offered})
            for stamp in stamps:
                raw = serialize_message(PoseStamped(header=header_of(stamp, 'map')))
                writer.add_message(channel, stamp, raw, stamp)
        writer.finish()
    process = nodes.start('bag_player', {'bag': str(path), 'paused': True, 'start': 0.3})
    topics = ('pose', 'goal')
    tester.until(lambda: all(tester.count_publishers(name) for name in topics), 'the player',
                 alive=process)
    [pose], [goal] = (tester.get_publishers_info_by_topic(name) for name in topics)
    assert pose.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT
    assert pose.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert goal.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert goal.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    goals = []
    tester.create_subscription(PoseStamped, 'goal', goals.append, QoSProfile(
        depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL
    ))  # fmt: skip
    tester.until(lambda: goals, 'what was latched before the start', alive=process)
    assert stamp_ns(goals[0].header) == STAMPS[0]


@pytest.mark.parametrize(('settings', 'words'), [
    ({'start': 9.0}, 'parameter start: the bag ends 1.000 s after its begin'),
    ({'bag': ''}, 'parameter bag'),
    ({'bag': '/nowhere/bag'}, '/nowhere/bag'),
    ({'rate': 0.0}, '0.01 to 100'),
    ({'topics': '/absent'}, '/absent'),
])  # fmt: skip
def test_what_cannot_be_played_is_told_in_one_line(nodes, bag, tmp_path, settings, words):
    process = nodes.start('bag_player', {'bag': str(bag), **settings})
    assert process.wait(PATIENCE) == 1
    said = (tmp_path / 'bag_player.log').read_text()
    assert words in said
    assert 'Traceback' not in said
