# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages, good and bad, through the door that node and replay share."""

from __future__ import annotations

import math

from camera_samples import HELD, make_calibration, make_camera, SMALL_CAMERA
import cv2
from message_samples import (
    camera_info,
    compressed_message,
    image_message,
    initial_pose,
    odometry_message,
    quaternion,
)
import numpy as np
import pytest

from gip_localizer.core.estimate import Status
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.parameters import Parameters
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.initial_pose import prior_of

S = 1_000_000_000
CALIBRATION = make_calibration('plumb_bob', **SMALL_CAMERA)
CAMERA = make_camera('plumb_bob', **SMALL_CAMERA)
COVARIANCE = np.diag([0.1**2, 0.1**2, 0.01**2])
PARAMETERS = Parameters.from_dict({
    'birdseye.near': 3.0, 'birdseye.far': 9.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.1, 'search.x': 0.4, 'search.y': 0.4, 'search.yaw': 0.03,
    'camera.x': HELD.x, 'camera.y': HELD.y, 'camera.z': HELD.z, 'camera.roll': HELD.roll,
    'camera.pitch': HELD.pitch, 'camera.yaw': HELD.yaw, 'recovery.automatic': False,
})


@pytest.fixture(scope='module')
def scene(road):
    pose = road.pose(0.1)
    return pose, road.frame(CAMERA, pose)


class Vehicle:
    """A frontend, its clock, and a frame to show it."""

    def __init__(self, road, scene) -> None:
        self.frontend = Frontend(road.map, PARAMETERS)
        self.truth, self.pixels = scene
        self.stamp = S

    def ready(self) -> Vehicle:
        self.frontend.on_camera_info(camera_info(CALIBRATION))
        self.frontend.on_initial_pose(initial_pose(self.truth, COVARIANCE))
        assert not self.frontend.complaints
        return self

    def show(self, pixels: np.ndarray | None = None, encoding: str = 'mono8', **changes):
        self.stamp += 50_000_000
        shown = self.pixels if pixels is None else pixels
        message = image_message(shown, encoding, stamp_ns=self.stamp)
        for name, value in changes.items():
            setattr(message, name, value)
        return self.frontend.on_image(message)

    def assert_localizes(self) -> None:
        estimate = self.show()
        assert estimate.status is Status.TRACKING, estimate.reason
        assert estimate.stamp_ns == self.stamp
        d = difference(estimate.pose, self.truth)
        assert math.hypot(d[0], d[1]) < 0.05
        assert abs(d[2]) < 0.005


@pytest.fixture
def vehicle(road, scene):
    return Vehicle(road, scene)


def test_messages_become_poses(vehicle):
    vehicle.ready().assert_localizes()
    assert vehicle.frontend.counts == {'camera_info': 1, 'initialpose': 1, 'image': 1}


@pytest.mark.parametrize('suffix', ['.png', '.jpg'])
def test_compressed_images_become_poses(vehicle, suffix):
    vehicle.ready()
    content = cv2.imencode(suffix, vehicle.pixels)[1].tobytes()
    estimate = vehicle.frontend.on_compressed_image(compressed_message(content, stamp_ns=2 * S))
    assert estimate.status is Status.TRACKING
    d = difference(estimate.pose, vehicle.truth)
    assert math.hypot(d[0], d[1]) < 0.05


def test_without_camera_info_nothing_is_published_and_a_late_one_is_enough(vehicle):
    vehicle.frontend.on_initial_pose(initial_pose(vehicle.truth, COVARIANCE))
    estimate = vehicle.show()
    assert estimate.status is Status.NO_CALIBRATION
    assert 'no camera_info' in estimate.reason
    vehicle.frontend.on_camera_info(camera_info(CALIBRATION))
    vehicle.assert_localizes()


BAD_INFO = {
    'not calibrated': {'k': np.zeros(9)},
    'NaN': {'k': np.full(9, np.nan)},
    'unknown': {'distortion_model': 'magic'},
    'numbers': {'d': np.ones(3)},
    'size': {'width': 0},
}


@pytest.mark.parametrize('word', BAD_INFO)
def test_a_bad_camera_info_is_told_and_replaces_nothing(vehicle, word):
    frontend = vehicle.frontend
    frontend.on_camera_info(camera_info(CALIBRATION, **BAD_INFO[word]))
    assert word in frontend.complaints['camera_info']
    assert frontend.counts['camera_info_refused'] == 1
    estimate = vehicle.show()
    assert estimate.status is Status.NO_CALIBRATION
    assert word in estimate.reason
    vehicle.ready().assert_localizes()
    frontend.on_camera_info(camera_info(CALIBRATION, **BAD_INFO[word]))
    assert word in frontend.complaints['camera_info']
    vehicle.assert_localizes()


def test_a_lens_without_its_name_is_used_and_said_with_every_frame(vehicle):
    vehicle.ready()
    vehicle.frontend.on_camera_info(camera_info(CALIBRATION, distortion_model=''))
    vehicle.assert_localizes()
    assert 'used as plumb_bob' in vehicle.frontend.warnings['LENS_UNNAMED']
    vehicle.frontend.on_camera_info(camera_info(CALIBRATION))
    vehicle.assert_localizes()
    assert 'LENS_UNNAMED' not in vehicle.frontend.warnings


def test_a_camera_info_that_changes_mid_run_is_taken(road, vehicle):
    vehicle.ready().assert_localizes()
    other = make_calibration('equidistant', size=(320, 180), focal=150.0)
    vehicle.frontend.on_camera_info(camera_info(other))
    camera = make_camera('equidistant', size=(320, 180), focal=150.0)
    vehicle.pixels = road.frame(camera, vehicle.truth)
    vehicle.assert_localizes()


@pytest.mark.parametrize('shape', [(90, 160), (360, 640), (180, 318), (1, 1)])
def test_an_image_of_another_size_is_refused(vehicle, shape):
    vehicle.ready()
    estimate = vehicle.show(np.full(shape, 90, np.uint8))
    assert estimate.status is Status.NO_CALIBRATION
    assert f'{shape[1]}x{shape[0]}' in estimate.reason
    assert '320x180' in estimate.reason
    vehicle.assert_localizes()


def test_an_image_one_pixel_off_is_forgiven(vehicle):
    vehicle.ready()
    vehicle.pixels = vehicle.pixels[:-1, :-1]
    vehicle.assert_localizes()


@pytest.mark.parametrize(('changes', 'word'), [
    ({'step': 100}, 'step'), ({'data': np.zeros(10, np.uint8)}, 'holds 10 bytes'),
    ({'data': np.zeros(0, np.uint8)}, 'holds 0 bytes'), ({'height': 0}, 'size'),
    ({'width': 0}, 'size'), ({'encoding': 'h264'}, 'h264'), ({'encoding': 'rgb8'}, 'step'),
])
def test_a_bad_image_is_told_and_the_next_is_localized(vehicle, changes, word):
    vehicle.ready()
    estimate = vehicle.show(**changes)
    assert estimate.status is Status.BAD_IMAGE
    assert estimate.pose is None
    assert word in estimate.reason
    assert vehicle.frontend.counts['image_refused'] == 1
    vehicle.assert_localizes()


def test_a_corrupt_jpeg_is_told_and_the_next_is_localized(vehicle):
    vehicle.ready()
    content = cv2.imencode('.jpg', vehicle.pixels)[1].tobytes()
    for broken in (content[: len(content) // 2], b'', bytes(300)):
        estimate = vehicle.frontend.on_compressed_image(compressed_message(broken, stamp_ns=S))
        assert estimate.status is Status.BAD_IMAGE
    vehicle.assert_localizes()


@pytest.mark.parametrize('level', [0, 255, 100])
def test_flat_frames_are_told(vehicle, level):
    estimate = vehicle.ready().show(np.full((180, 320), level, np.uint8))
    assert estimate.status is Status.LOW_CONTRAST
    vehicle.assert_localizes()


def test_a_camera_at_the_sky_or_level_is_told(vehicle):
    vehicle.ready().assert_localizes()
    for pitch in (-1.0, 1.5):
        vehicle.frontend.configure(PARAMETERS.replace({'camera.pitch': pitch}))
        estimate = vehicle.show()
        assert estimate.status is Status.NO_ROAD_IN_VIEW
        assert 'camera.pitch' in estimate.reason
    vehicle.frontend.configure(PARAMETERS)
    vehicle.assert_localizes()


NOWHERE = initial_pose(Pose2(10.0, 10.0, 0.0), COVARIANCE)
NOWHERE.pose.pose.orientation = quaternion(0.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(('message', 'word'), [
    (initial_pose(Pose2(10.0, 10.0, 0.0), COVARIANCE, frame='odom'), "'odom'; expected 'map'"),
    (initial_pose(Pose2(10.0, 10.0, 0.0), COVARIANCE, frame=''), "frame ''"),
    (initial_pose(Pose2(math.nan, 10.0, 0.0), COVARIANCE), 'NaN'),
    (initial_pose(Pose2(10.0, 10.0, math.nan), COVARIANCE), 'NaN'),
    (initial_pose(Pose2(9e3, 10.0, 0.0), COVARIANCE), 'outside the map'),
    (initial_pose(Pose2(10.0, 10.0, 0.0), COVARIANCE * math.nan), 'NaN'),
    (initial_pose(Pose2(10.0, 10.0, 0.0), -COVARIANCE), 'not positive definite'),
    (initial_pose(Pose2(10.0, 10.0, 0.0), np.diag([0.1, 0.0, -0.1])), 'not positive definite'),
    (NOWHERE, 'length 0'),
])
def test_a_bad_initial_pose_is_told_and_the_belief_stays(vehicle, message, word):
    vehicle.ready().assert_localizes()
    vehicle.frontend.on_initial_pose(message)
    assert word in vehicle.frontend.complaints['initialpose']
    assert 'belief is kept' in vehicle.frontend.complaints['initialpose']
    vehicle.assert_localizes()
    vehicle.frontend.on_initial_pose(initial_pose(vehicle.truth, COVARIANCE))
    assert not vehicle.frontend.complaints


def test_a_frame_name_with_a_slash_is_the_same_frame(vehicle):
    vehicle.ready()
    vehicle.frontend.on_initial_pose(initial_pose(vehicle.truth, COVARIANCE, frame='/map'))
    assert not vehicle.frontend.complaints


def test_bad_odometry_is_told_and_forgotten_after_a_good_one(vehicle):
    vehicle.ready()
    frontend, stamp = vehicle.frontend, 2 * S
    nan = odometry_message(stamp, Pose2(math.nan, 0.0, 0.0))
    other = odometry_message(stamp, Pose2(0.0, 0.0, 0.0), child='trailer')
    unset = odometry_message(stamp, Pose2(0.0, 0.0, 0.0))
    unset.pose.pose.orientation = quaternion(0.0, 0.0, 0.0, 0.0)
    spinning = odometry_message(stamp, Pose2(0.0, 0.0, 0.0), turn=math.nan)
    for message, word in [(nan, 'NaN'), (other, "'trailer'"), (unset, 'length 0'),
                          (spinning, 'NaN')]:
        frontend.on_odometry(message)
        assert word in frontend.complaints['odom']
    assert frontend.counts['odom_refused'] == 4
    frontend.on_odometry(odometry_message(stamp, Pose2(0.0, 0.0, 0.0)))
    assert 'odom' not in frontend.complaints
    frontend.on_odometry(odometry_message(stamp + 20_000_000, Pose2(300.0, 0.0, 0.0)))
    assert 'jumped' in frontend.complaints['odom']
    frontend.on_odometry(odometry_message(stamp, Pose2(300.0, 0.0, 0.0)))
    assert 'before the last' in frontend.complaints['odom']
    vehicle.assert_localizes()


def test_rectified_images_are_read_by_p(vehicle):
    frontend = vehicle.ready().frontend
    frontend.configure(PARAMETERS.replace({'camera.rectified': True}))
    estimate = vehicle.show()
    assert estimate.status is Status.NO_CALIBRATION
    assert 'P has focal lengths 0' in estimate.reason
    frontend.configure(PARAMETERS)
    vehicle.assert_localizes()


def test_binning_declared_for_an_image_that_was_not_binned_is_named(road, scene):
    vehicle = Vehicle(road, scene).ready()
    binned = camera_info(CALIBRATION)
    binned.binning_x = binned.binning_y = 2
    vehicle.frontend.on_camera_info(binned)
    estimate = vehicle.show()
    assert estimate.status is Status.NO_CALIBRATION
    assert 'before binning 2x2' in estimate.reason


@pytest.mark.parametrize('given', [(0.0, 0.0, 0.0), (0.04, 0.0, 0.0), (0.04, 0.09, 0.0)])
def test_variances_that_are_zero_are_those_of_the_parameters(given):
    message = initial_pose(Pose2(4.0, 4.0, 0.0), np.diag(given))
    start = PARAMETERS.initial_pose
    _, covariance = prior_of(message, PARAMETERS, RasterMap(np.zeros((9, 9), np.uint8), 1.0))
    defaults = (start.sigma_xy**2, start.sigma_xy**2, start.sigma_yaw**2)
    expected = [value or default for value, default in zip(given, defaults, strict=True)]
    np.testing.assert_allclose(covariance, np.diag(expected))
