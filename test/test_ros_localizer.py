# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `localizer` as a process of its own, over real DDS."""

from __future__ import annotations

from array import array
import math

import numpy as np
import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import OccupancyGrid
from rclpy.qos import qos_profile_sensor_data
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import (
    assert_near,
    camera_info,
    frames,
    initial_pose,
    localized,
    parameters,
    SECOND,
    send,
    START,
    WORLD,
)  # fmt: skip
from ros_support import PATIENCE
from sensor_msgs.msg import Image
from std_msgs.msg import Float64

from gip_localizer.core.pose import Pose2
from gip_localizer.ros.conversions import mono8

pytestmark = pytest.mark.ros


def test_the_pose_that_arrives_is_right(tester, localizer, render):
    truth = START @ Pose2(0.21, -0.13, 0.02)
    images = frames(render(truth), 1_700_000_000 * SECOND + 23_456_789)
    pose = localized(tester, images, localizer)
    assert_near(pose, truth)
    assert 1_700_000_000 <= pose.header.stamp.sec < 1_700_000_010
    assert pose.header.stamp.nanosec % (SECOND // 10) == 23_456_789
    assert pose.header.frame_id == 'map'
    tester.until(lambda: tester.with_covariance, 'the pose with its covariance')
    full = np.reshape(tester.with_covariance[-1].pose.covariance, (6, 6))
    assert np.linalg.eigvalsh(full).min() > 0.0
    assert 1e-5 < math.sqrt(full[0, 0]) < 0.05
    tester.until(lambda: b'\0' in tester.levels(), 'diagnostics OK')


def test_an_initial_pose_from_outside_moves_the_search(tester, localizer, render):
    elsewhere = Pose2(-2.0, 1.5, 1.2)
    tester.initial.publish(initial_pose(elsewhere @ Pose2(0.1, 0.1, -0.02)))
    for _ in range(10):
        tester.executor_.spin_once(timeout_sec=0.02)
    assert_near(localized(tester, frames(render(elsewhere)), localizer), elsewhere)


REFUSED = (
    ('search.x', -1.0, 'search.x'),
    ('search.x', 'wide', 'search.x'),
    ('score.metric', 'manhattan', 'gip_normalized'),
    ('birdseye.near', 50.0, 'birdseye.far'),
    ('map_file', '/other.yaml', 'there is no such file'),
    ('mask_file', '/other.png', 'read-only'),
)


def test_bad_parameters_are_refused_with_a_reason_and_the_old_stay(tester, localizer):
    for name, value, reason in REFUSED:
        before = tester.get(name)
        result = tester.set(name, value)
        assert not result.successful, name
        assert any(word in result.reason.lower() for word in (reason, 'range', 'type',
                                                              'read-only')), (name, result.reason)
        assert tester.get(name) == before
        assert localizer.poll() is None


def test_a_parameter_set_from_outside_changes_the_match(tester, localizer, render):
    truth = START @ Pose2(0.2, 0.1, -0.01)
    images = frames(render(truth))
    assert_near(localized(tester, images, localizer), truth)
    assert tester.set('score.metric', 'gip').successful
    assert tester.get('score.metric') == 'gip'
    assert_near(localized(tester, images, localizer), truth)


def test_parameters_are_described_with_range_and_unit(tester, localizer):
    described = tester.describe('camera.z')
    assert described.description.endswith('[m]')
    [bounds] = described.floating_point_range
    assert bounds.from_value == 0.01
    assert bounds.to_value == 100.0
    assert tester.describe('mask_file').read_only
    assert not tester.describe('map_file').read_only


BROKEN = {
    'short data': Image(height=240, width=320, encoding='mono8', step=320, data=array('B', b'12')),
    'step too small': Image(
        height=240, width=320, encoding='mono8', step=8, data=array('B', bytes(320 * 240))
    ),
    'no pixels': Image(),
    'unknown encoding': Image(
        height=240, width=320, encoding='holo9', step=320, data=array('B', bytes(320 * 240))
    ),
    'other size': mono8(SECOND, 'camera', np.full((100, 100), 128, np.uint8)),
    'black': mono8(SECOND, 'camera', np.zeros((240, 320), np.uint8)),
    'white': mono8(SECOND, 'camera', np.full((240, 320), 255, np.uint8)),
}


def test_no_bad_frame_ends_the_node_or_makes_a_pose(tester, localizer, render):
    for image in BROKEN.values():
        send(tester, image, localizer)
    tester.until(lambda: tester.said('output', 'WITHHELD'), 'a report of the bad frames')
    assert tester.poses == []
    assert tester.levels() <= {b'\1', b'\2'}
    truth = START @ Pose2(0.05, 0.05, 0.0)
    images = frames(render(truth))
    assert_near(localized(tester, images, localizer), truth)


@pytest.mark.parametrize('changes', [
    {'k': np.zeros(9)},
    {'k': np.full(9, math.nan)},
    {'distortion_model': 'crystal_ball'},
    {'width': 0, 'height': 0},
], ids=lambda changes: next(iter(changes)))  # fmt: skip
def test_a_bad_calibration_is_reported_and_a_good_one_mends_it(
    tester, localizer, render, changes
):
    truth = START @ Pose2(0.05, 0.05, 0.0)
    images = frames(render(truth))

    def reported():
        send(tester, next(images), localizer, camera_info(**changes))
        return tester.said('calibration', 'NO_CALIBRATION: CameraInfo')

    tester.until(reported, 'a report of the calibration', alive=localizer)
    assert tester.poses == []
    assert_near(localized(tester, images, localizer), truth)


def test_priors_are_refused_and_each_new_reason_is_logged(tester, localizer, tmp_path):
    moon, not_finite = initial_pose(START, 'moon'), initial_pose(Pose2(math.nan, 0.0, 0.0))
    far = initial_pose(Pose2(500.0, 0.0, 0.0))
    for bad, reason in ((moon, "in frame 'moon'"), (not_finite, 'NaN'), (far, 'outside the map')):
        tester.diagnostics.clear()
        tester.initial.publish(bad)
        tester.until(
            lambda: tester.said('prior', 'INITIALPOSE_REFUSED'), 'a report', alive=localizer
        )
        tester.until(
            lambda reason=reason: logged(tmp_path, 'INITIALPOSE_REFUSED', reason),
            f'{reason} in the log', alive=localizer,
        )


def logged(folder, rule, reason):
    """Return whether a line of the node's log names a rule and its reason."""
    lines = (folder / 'localizer.log').read_text().splitlines()
    return any(rule in line and reason in line for line in lines)


def test_services_disable_and_enable(tester, localizer, render):
    assert tester.switch('/localizer/enable', False).success
    tester.until(lambda: tester.said('output', 'DISABLED'), 'the word disabled')
    images = frames(render(START))
    for _ in range(10):
        send(tester, next(images), localizer)
    assert tester.poses == []
    assert tester.switch('/localizer/enable', True).success
    assert_near(localized(tester, images, localizer), START)


def test_relocalize_finds_the_vehicle_anywhere_on_the_map(tester, localizer, render):
    far_off = Pose2(-4.0, 3.0, 2.0)
    assert tester.trigger('/localizer/relocalize').success
    images = frames(render(far_off))
    assert_near(localized(tester, images, localizer), far_off)


def test_the_map_is_shown_as_it_is(tester, localizer):
    tester.until(lambda: tester.maps, 'the map')
    [grid] = tester.maps
    assert isinstance(grid, OccupancyGrid)
    assert (grid.info.width, grid.info.height) == (500, 500)
    assert math.isclose(grid.info.resolution, 0.04, rel_tol=1e-6)
    shown = np.reshape(grid.data, (500, 500))
    # Row 0 of the message is the lowest of the map; white is 0.
    assert shown[0, 0] == pytest.approx(100.0 * (1.0 - WORLD.grey[-1, 0]), abs=1.0)
    assert shown[-1, 7] == pytest.approx(100.0 * (1.0 - WORLD.grey[0, 7]), abs=1.0)


def test_pictures_are_sent_while_someone_looks(tester, localizer, render):
    seen, times = {}, []
    for topic in ('birdseye', 'comparison', 'overlay'):
        tester.create_subscription(
            Image, f'/localizer/{topic}', lambda m, t=topic: seen.__setitem__(t, m),
            qos_profile_sensor_data,
        )
    tester.create_subscription(Float64, '/localizer/execution_time_ms', times.append, 10)
    images = frames(render(START))

    def came():
        send(tester, next(images), localizer)
        return len(seen) == 3 and times

    tester.until(came, 'all pictures and the time', alive=localizer)
    assert all(np.ptp(np.asarray(picture.data)) > 10 for picture in seen.values())
    overlay = seen['overlay']
    assert (overlay.width, overlay.height, overlay.encoding) == (320, 240, 'bgr8')
    assert overlay.header.frame_id == 'camera'
    assert seen['comparison'].width > 3 * seen['birdseye'].width
    assert times[-1].data > 0.0


@pytest.mark.parametrize(('changes', 'words'), [
    ({'search.x': -3.0}, ('search.x', '-3.0', '0 to 1000')),
    ({'score.metric': 'manhattan'}, ('score.metric', 'manhattan', 'euclidean')),
    ({'camera.z': 'high'}, ('camera.z', 'high', '0.01 to 100')),
    ({'map_file': '/nowhere/map.yaml'}, ('/nowhere/map.yaml',)),
    ({'map_file': ''}, ('map_file',)),
    ({'birdseye.near': 60.0}, ('birdseye.near', 'birdseye.far')),
])  # fmt: skip
def test_bad_parameters_at_start_end_with_one_clear_line(
    nodes, map_file, tmp_path, changes, words
):
    process = nodes.start('localizer', parameters(map_file, changes))
    assert process.wait(PATIENCE) == 1
    said = (tmp_path / 'localizer.log').read_text()
    assert 'Traceback' not in said
    assert all(word in said for word in words), said
    assert '[FATAL]' in said
