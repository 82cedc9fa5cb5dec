# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What a vehicle's stack relies on, over real DDS: lifecycle, restart, QoS, time, diagnostics."""

from __future__ import annotations

from itertools import count
import json
import math
from pathlib import Path
import xml.etree.ElementTree as ElementTree

import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import (
    assert_near,
    camera_info,
    EXTRINSICS,
    frames,
    initial_pose,
    localized,
    parameters,
    SECOND,
    send,
    START,
)  # fmt: skip
from ros_support import PATIENCE
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Float64

from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import load_parameter_file
from gip_localizer.parameters.ros_yaml import dump_ros_yaml
from gip_localizer.ros.conversions import header_of, pose_of, time_of
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS

CONFIG = Path(__file__).parents[1] / 'config'
pytestmark = pytest.mark.ros


def start(nodes, tester, map_file, changes):
    process = nodes.start('localizer', parameters(map_file, changes))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    return process


def spin(tester, times=10):
    for _ in range(times):
        tester.executor_.spin_once(timeout_sec=0.02)


def odometry(stamp_ns, pose, child='base_link'):
    message = Odometry(header=header_of(stamp_ns, 'odom'), child_frame_id=child)
    message.pose.pose = pose_of(pose)
    return message


def test_every_concern_has_its_status_with_the_figures_of_the_table(tester, localizer, render):
    localized(tester, frames(render(START)), localizer)
    tester.until(lambda: tester.said('output', 'OK: TRACKING'), 'diagnostics of the pose')
    for group in DIAGNOSTIC_GROUPS:
        status = tester.status(group.name)
        keys = [value.key for value in status.values]
        assert set(keys) <= set(group.figures)
        assert len(keys) == len(set(keys))
    keys = {value.key for value in tester.status('match').values}
    assert keys == set(next(c.figures for c in DIAGNOSTIC_GROUPS if c.name == 'match'))


def test_a_camera_that_falls_silent_is_told_by_name(tester, localizer, render):
    localized(tester, frames(render(START)), localizer)
    tester.until(lambda: tester.said('camera', 'NO_IMAGE: for'), 'a report of the silence')
    assert tester.said('output', 'WITHHELD: NO_IMAGE')


def test_odometry_that_jumps_or_is_of_another_frame_is_told(tester, localizer):
    seconds = count(1)

    def jumped():
        stamp = next(seconds)
        tester.odom.publish(odometry(stamp * SECOND, Pose2(500.0 * (stamp % 2), 0.0, 0.0)))
        return tester.said('odometry', 'jumped 500')

    tester.until(jumped, 'a report of the jump')

    def of_another_frame():
        tester.odom.publish(odometry(next(seconds) * SECOND, Pose2(0.0, 0.0, 0.0), 'trailer'))
        return tester.said('odometry', 'trailer')

    tester.until(of_another_frame, 'a report of the frame')


def test_figures_and_the_last_pose_have_topics(tester, localizer, render):
    seen = {topic: [] for topic in ('quality', 'score', 'execution_time_ms')}
    for topic, heard in seen.items():
        tester.create_subscription(Float64, f'/localizer/{topic}', heard.append, 10)
    images = frames(render(START))
    pose = localized(tester, images, localizer)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    late = []
    tester.create_subscription(
        PoseWithCovarianceStamped, '/localizer/last_pose', late.append, latched
    )
    tester.until(lambda: late, 'the last pose, for one who came late')
    assert late[-1].header.stamp.sec >= pose.header.stamp.sec

    def came():
        send(tester, next(images), localizer)
        return all(seen.values())

    tester.until(came, 'all figures', alive=localizer)
    assert 0.7 <= seen['quality'][-1].data <= 1.0
    assert 0.5 <= seen['score'][-1].data <= 1.0


def test_a_group_of_parameters_is_taken_whole_or_not_at_all(tester, localizer):
    def ask(**values):
        request = SetParametersAtomically.Request(parameters=[
            Parameter(f'birdseye.{name}', value=value).to_parameter_msg()
            for name, value in values.items()
        ])  # fmt: skip
        return tester.ask(
            SetParametersAtomically, '/localizer/set_parameters_atomically', request
        ).result

    refused = ask(near=30.0, far=20.0)
    assert not refused.successful
    assert 'birdseye.far' in refused.reason
    assert (tester.get('birdseye.near'), tester.get('birdseye.far')) == (1.8, 6.0)
    # Each alone would be refused: the view would be empty in between.
    assert ask(near=7.0, far=9.0).successful
    assert (tester.get('birdseye.near'), tester.get('birdseye.far')) == (7.0, 9.0)


def test_quality_of_service_is_overridden_by_parameters(nodes, tester, map_file):
    override = 'qos_overrides./image.subscription.reliability'
    start(nodes, tester, map_file, {override: 'reliable'})

    def asked():
        return [e.qos_profile.reliability.name
                for e in tester.get_subscriptions_info_by_topic('/image')
                if e.node_name == 'localizer']

    tester.until(asked, 'the subscription to be known')
    assert asked() == ['RELIABLE']


def test_a_quality_of_service_of_no_topic_of_the_node_is_told(nodes, tester, map_file, tmp_path):
    start(nodes, tester, map_file, {'qos_overrides./imag.subscription.depth': 3})
    log = tmp_path / 'localizer.log'
    words = ('qos_overrides./imag.subscription.depth is unknown and ignored; '
             'did you mean qos_overrides./image.subscription.depth?')
    tester.until(lambda: words in log.read_text(), 'the warning')


def test_a_dump_of_the_node_is_a_parameter_file_of_the_desk_tool(tester, localizer, tmp_path):
    request = ListParameters.Request()
    names = tester.ask(ListParameters, '/localizer/list_parameters', request).result.names
    path = tmp_path / 'dump.yaml'
    path.write_text(dump_ros_yaml(tester.get_all(names), '/localizer'))
    assert load_parameter_file(path).camera.pitch == EXTRINSICS.pitch


def test_a_wrong_quality_of_service_ends_the_start_with_one_line(nodes, map_file, tmp_path):
    override = 'qos_overrides./image.subscription.reliability'
    process = nodes.start('localizer', parameters(map_file, {override: 'perfect'}))
    assert process.wait(PATIENCE) == 1
    said = (tmp_path / 'localizer.log').read_text()
    assert 'Traceback' not in said
    assert 'perfect' in said
    assert 'best_effort' in said


@pytest.mark.parametrize('parameter', ['tf.publish', 'camera.from_tf'])
def test_without_tf_the_parameters_say_so(nodes, map_file, tmp_path, parameter):
    pytest.importorskip('rclpy')
    try:
        import tf2_msgs.msg  # noqa: F401
    except ImportError:
        pass
    else:
        pytest.skip('tf2_msgs is installed')
    process = nodes.start('localizer', parameters(map_file, {parameter: True}))
    assert process.wait(PATIENCE) == 1
    said = (tmp_path / 'localizer.log').read_text()
    assert 'Traceback' not in said
    assert f'parameter {parameter}' in said
    assert 'TF is unavailable' in said


def test_every_accepted_command_is_one_line_of_the_log(localizer, tester, render, tmp_path):
    log = tmp_path / 'localizer.log'

    def logged(*lines):
        tester.until(lambda: all(line in log.read_text() for line in lines), lines[0])

    localized(tester, frames(render(START)), localizer)
    logged('calibration taken: 320 x 240 pixels', 'plumb_bob', 'computed in ')
    before = tester.get('search.x')
    assert tester.set('search.x', 0.6).successful
    logged(f'parameter search.x: {before} -> 0.6')
    assert not tester.set('search.x', -1.0).successful
    tester.initial.publish(initial_pose(START))
    logged(f'initial pose taken: x {START.x:.3f} m, y {START.y:.3f} m', 'deviations 0.2 m, 0.2 m')
    assert tester.trigger('/localizer/relocalize').success
    logged('search of the whole map requested')
    assert tester.switch('/localizer/enable', on=False).success
    logged('~/enable: images are ignored')
    assert '-> -1' not in log.read_text()


def allowed(direction):
    """Names that the policy allows in a direction."""
    root = ElementTree.parse(CONFIG / 'sros2_policy.xml').getroot()
    [section] = [part for part in root.find('.//profile') if direction in part.attrib]
    return {'/' + item.text.replace('~', 'localizer') for item in section}


def names_of(kind, tester):
    ask = getattr(tester, f'get_{kind}_names_and_types_by_node')
    return {name for name, _ in ask('localizer', '/')}


def test_the_security_policy_allows_what_the_node_has(nodes, tester, map_file):
    changes = {'lifecycle': True, 'use_sim_time': True, 'mask.from_topic': True}
    process = nodes.start('localizer', parameters(map_file, changes))
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    tester.until(tester.matched, 'the topics', alive=process)
    optional = {'/image/compressed', '/image/foxglove', '/tf', '/tf_static', '/bond'}
    tester.until(
        lambda: names_of('subscriber', tester) | optional == allowed('subscribe'), 'the inputs'
    )
    tester.until(
        lambda: names_of('publisher', tester) | {'/tf', '/bond'} == allowed('publish'), 'outputs'
    )
    tester.until(lambda: names_of('service', tester) == allowed('reply'), 'the services')


def change_state(tester, transition):
    request = ChangeState.Request(transition=Transition(id=transition))
    return tester.ask(ChangeState, '/localizer/change_state', request).success


def state(tester):
    return tester.ask(GetState, '/localizer/get_state', GetState.Request()).current_state.id


def test_a_managed_node_goes_through_its_states(nodes, tester, map_file, render):
    process = nodes.start('localizer', parameters(map_file, {'lifecycle': True}))
    assert state(tester) == State.PRIMARY_STATE_UNCONFIGURED
    assert not tester.count_publishers('pose')
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    tester.until(tester.matched, 'the topics', alive=process)
    images = frames(render(START))
    for _ in range(5):
        send(tester, next(images), process)
    assert tester.poses == []
    tester.until(lambda: tester.said('output', 'DISABLED'), 'the word of the inactive node')
    assert change_state(tester, Transition.TRANSITION_ACTIVATE)
    assert_near(localized(tester, images, process), START)
    assert change_state(tester, Transition.TRANSITION_DEACTIVATE)
    spin(tester)
    heard = len(tester.poses)
    for _ in range(5):
        send(tester, next(images), process)
    assert len(tester.poses) == heard
    assert change_state(tester, Transition.TRANSITION_CLEANUP)
    tester.until(lambda: not tester.count_publishers('pose'), 'the topics to go')
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert change_state(tester, Transition.TRANSITION_ACTIVATE)
    tester.until(tester.matched, 'the topics again', alive=process)
    assert_near(localized(tester, images, process), START)


def test_a_managed_node_starts_by_itself_where_asked(nodes, tester, map_file, render):
    process = nodes.start('localizer', parameters(map_file, {
        'lifecycle': True, 'autostart_node': True,
    }))  # fmt: skip
    tester.until(tester.matched, 'the topics', alive=process)
    assert_near(localized(tester, frames(render(START)), process), START)
    assert state(tester) == State.PRIMARY_STATE_ACTIVE
    assert change_state(tester, Transition.TRANSITION_DEACTIVATE)


def test_an_active_node_holds_a_bond_and_parts_when_it_is_deactivated(nodes, tester, map_file):
    """The tester is the lifecycle manager: it has the same bond under another instance."""
    kind = pytest.importorskip('bond.msg', reason='the package bond is not in the wheels').Status
    heard, own = [], kind(id='localizer', instance_id='manager', active=True)
    tester.create_subscription(
        kind, 'bond', lambda one: one.instance_id == 'manager' or heard.append(one), 100
    )
    sender = tester.create_publisher(kind, 'bond', 5)
    nodes.start('localizer', parameters(map_file, {'lifecycle': True}))
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert heard == []
    assert change_state(tester, Transition.TRANSITION_ACTIVATE)

    def formed():
        sender.publish(own)
        return len(heard) >= 5

    tester.until(formed, 'the messages of the bond')
    assert {(one.id, one.active) for one in heard} == {('localizer', True)}
    assert len({one.instance_id for one in heard}) == 1
    assert change_state(tester, Transition.TRANSITION_DEACTIVATE)
    tester.until(lambda: not heard[-1].active, 'the end of the bond')
    count = len(heard)
    tester.spin(0.5)
    assert len(heard) == count


def test_a_managed_node_refuses_transitions_that_its_state_does_not_have(
    nodes, tester, map_file
):
    process = nodes.start('localizer', parameters(map_file, {'lifecycle': True}))
    for transition in (Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_CLEANUP, 99):
        assert not change_state(tester, transition)
        assert state(tester) == State.PRIMARY_STATE_UNCONFIGURED
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert not change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert not change_state(tester, Transition.TRANSITION_DEACTIVATE)
    assert state(tester) == State.PRIMARY_STATE_INACTIVE
    assert process.poll() is None


def test_enable_and_the_state_of_a_managed_node_do_not_overrule_each_other(
    nodes, tester, map_file, render
):
    process = nodes.start('localizer', parameters(map_file, {'lifecycle': True}))
    images = frames(render(START))

    def silent():
        heard = len(tester.poses)
        for _ in range(8):
            send(tester, next(images), process)
        return len(tester.poses) == heard

    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    tester.until(tester.matched, 'the topics', alive=process)
    assert 'not active' in tester.switch('/localizer/enable', True).message
    assert silent()
    tester.until(lambda: tester.said('output', 'until the node is activated'), 'the reason')
    assert tester.switch('/localizer/enable', False).success
    assert change_state(tester, Transition.TRANSITION_ACTIVATE)
    assert silent()
    tester.until(lambda: tester.said('output', '~/enable is called'), 'the other reason')
    assert tester.switch('/localizer/enable', True).success
    assert_near(localized(tester, images, process), START)


def test_a_managed_node_with_a_bad_map_stays_unconfigured(nodes, tester, tmp_path):
    nodes.start('localizer', {'lifecycle': True, 'map_file': '/nowhere/map.yaml'})
    assert not change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert state(tester) == State.PRIMARY_STATE_UNCONFIGURED
    assert '/nowhere/map.yaml' in (tmp_path / 'localizer.log').read_text()


def test_a_failed_configure_is_repaired_by_a_parameter(nodes, tester, map_file):
    nodes.start('localizer', {'lifecycle': True, 'map_file': '/nowhere/map.yaml'})
    assert not change_state(tester, Transition.TRANSITION_CONFIGURE)
    assert tester.set('map_file', str(map_file)).successful
    assert change_state(tester, Transition.TRANSITION_CONFIGURE)
    refused = tester.set('frames.map', 'moon')
    assert not refused.successful
    assert 'clean it up first' in refused.reason
    assert not tester.set('lifecycle', False).successful


def test_a_killed_node_is_back_where_it_was(nodes, tester, map_file, render, tmp_path):
    far_off = Pose2(-4.0, 3.0, 2.0)
    path = tmp_path / 'state.json'
    keep = {'state_file': str(path), 'initial_pose.set': False, 'recovery.automatic': False}
    process = start(nodes, tester, map_file, keep)
    tester.initial.publish(initial_pose(far_off))
    spin(tester)
    images = frames(render(far_off))
    assert_near(localized(tester, images, process), far_off)
    tester.until(path.exists, 'the file')
    process.kill()
    process.wait()
    nodes.end('localizer')
    again = start(nodes, tester, map_file, keep)
    assert_near(localized(tester, images, again), far_off)


def test_a_state_of_another_map_is_told_and_not_used(nodes, tester, map_file, render, tmp_path):
    path = tmp_path / 'state.json'
    keep = {'state_file': str(path), 'initial_pose.set': False, 'recovery.automatic': False}
    content = {'format': 1, 'map_hash': 'f' * 16, 'frame': 'map', 'saved_at': 1e9,
               'pose': list(START), 'covariance': [0.01, 0, 0, 0, 0.01, 0, 0, 0, 0.001]}
    path.write_text(json.dumps(content))
    process = start(nodes, tester, map_file, keep)
    tester.until(lambda: tester.said('prior', 'another map'), 'the refusal')
    images = frames(render(START))
    for _ in range(10):
        send(tester, next(images), process)
    assert tester.poses == []


def test_simulated_time_stands_goes_on_and_goes_back(nodes, tester, map_file, render):
    process = start(nodes, tester, map_file, {'use_sim_time': True})
    clock = tester.create_publisher(Clock, '/clock', 10)
    pixels = render(START)

    def at(seconds):
        clock.publish(Clock(clock=time_of(seconds * SECOND)))
        spin(tester, 3)
        return frames(pixels, seconds * SECOND)

    pose = localized(tester, at(5000), process)
    assert pose.header.stamp.sec == 5000
    tester.until(lambda: tester.said('camera', 'CLOCK_STOPPED'), 'a report of the stopped clock')
    # The bag begins again: the belief starts anew, from the parameters.
    tester.poses.clear()
    pose = localized(tester, at(1000), process)
    assert 1000 <= pose.header.stamp.sec < 1010
    assert_near(pose, START)
    tester.until(lambda: tester.said('camera', 'TIME_WENT_BACK'), 'a report of the loop')


def test_a_clock_that_stands_is_told_where_simulated_time_was_set_later(tester, localizer):
    assert tester.set('use_sim_time', True).successful
    tester.until(lambda: tester.said('camera', 'CLOCK_STOPPED'), 'a report of the stopped clock')
    assert tester.set('use_sim_time', False).successful
    tester.until(lambda: not tester.said('camera', 'CLOCK_STOPPED'), 'its end')


def test_frames_late_and_of_the_future_are_told_and_keep_their_stamps(
    tester, localizer, render
):
    # The tester's clock is the system's: stamps of 2023 are late.
    pose = localized(tester, frames(render(START)), localizer)
    assert pose.header.stamp.sec < 1_700_000_100
    tester.until(lambda: tester.said('camera', 'LATE_FRAMES'), 'a report of late frames')
    future = frames(render(START), 4_000_000_000 * SECOND // 2)
    localized(tester, future, localizer)
    tester.until(lambda: tester.said('camera', 'FUTURE_STAMPS'), 'a report of the future')


def test_a_camera_that_changes_its_size_goes_on(tester, localizer, render):
    images = frames(render(START))
    assert_near(localized(tester, images, localizer), START)
    wrong = camera_info(width=640, height=480)

    def reported():
        send(tester, next(images), localizer, wrong)
        return tester.said('calibration', 'NO_CALIBRATION')

    tester.until(reported, 'a report of the sizes', alive=localizer)
    assert_near(localized(tester, images, localizer), START)
    assert math.isfinite(tester.poses[-1].pose.position.x)
