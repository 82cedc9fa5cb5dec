# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `bag_player` as a process of its own: what was recorded comes, when it should."""

import time

import pytest

pytest.importorskip('rclpy')

from forked_nodes import fork
from ros_support import GRAPH, PATIENCE, Tester
from rosgraph_msgs.msg import Clock

from gip_localizer.core.pose import Pose2
from gip_localizer.io.bags.writer import BagWriter, make, make_header, make_pose
from gip_localizer.io.messages import planar_pose, stamp_ns
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


@pytest.mark.parametrize(('settings', 'words'), [
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
