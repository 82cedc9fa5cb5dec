# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Mutated messages of every subscribed type: no exception, and no pose that is wrong.

`GIP_FUZZ=10000 python -m pytest test/test_fuzz_messages.py` tries so many of each.

"""

from __future__ import annotations

import math
import os

from camera_samples import HELD, make_calibration, make_camera
import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
from message_samples import (
    camera_info,
    compressed_message,
    image_message,
    initial_pose,
    odometry_message,
)
from mutations import mutated
import numpy as np
import pytest

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.io.frontend import Frontend
from gip_localizer.parameters import Parameters

MANY = settings(max_examples=int(os.environ.get('GIP_FUZZ', '60')))
S = 1_000_000_000
START = 1_700_000_000 * S
STEP = S // 20
CALIBRATION = make_calibration('plumb_bob')
CAMERA = make_camera('plumb_bob')
COVARIANCE = np.diag([0.1**2, 0.1**2, 0.01**2])
PARAMETERS = Parameters.from_dict({
    'birdseye.near': 3.0, 'birdseye.far': 9.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.1, 'search.x': 0.4, 'search.y': 0.4, 'search.yaw': 0.03,
    'camera.x': HELD.x, 'camera.y': HELD.y, 'camera.z': HELD.z, 'camera.roll': HELD.roll,
    'camera.pitch': HELD.pitch, 'camera.yaw': HELD.yaw, 'recovery.automatic': False,
})


class Vehicle:
    """A frontend that knows where it is, and a judge of what it says."""

    def __init__(self, road):
        self.truth = road.pose(0.1)
        self.map = road.map
        self.pixels = road.frame(CAMERA, self.truth)
        self.jpeg = cv2.imencode('.jpg', self.pixels)[1].tobytes()
        self.frontend = Frontend(road.map, PARAMETERS)
        self.clean()

    def clean(self):
        """Give it a good calibration and a good prior, long after all that came before."""
        newest = self.frontend.localizer.tracker.odometry.latest
        self.frontend.on_camera_info(camera_info(CALIBRATION))
        self.frontend.on_initial_pose(initial_pose(self.truth, COVARIANCE))
        if newest is not None:
            self.frontend.localizer.tracker.odometry.clear()
        self.stamp = START

    def image(self, stamp):
        return image_message(self.pixels, 'mono8', stamp_ns=stamp)

    def judge(self, estimate):
        """A published pose is whole, on the map, honest of its uncertainty and right."""
        if estimate.pose is None:
            assert estimate.reason
            return
        assert all(math.isfinite(value) for value in estimate.pose)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        apart = difference(estimate.pose, self.truth)
        assert math.hypot(apart[0], apart[1]) < 0.5
        assert abs(apart[2]) < math.radians(2.0)


@pytest.fixture(scope='module')
def vehicle(road):
    return Vehicle(road)


@pytest.fixture(scope='module')
def good(vehicle):
    """One good message of each type."""
    odometry = odometry_message(START - STEP, Pose2(1.0, 2.0, 0.3), forward=1.0)
    return {
        'image': vehicle.image(START),
        'compressed': compressed_message(vehicle.jpeg, stamp_ns=START),
        'camera_info': camera_info(CALIBRATION),
        'odometry': odometry,
        'initial_pose': initial_pose(vehicle.truth, COVARIANCE),
    }


@MANY
@given(data=st.data())
def test_mutated_images(vehicle, good, data):
    vehicle.clean()
    vehicle.judge(vehicle.frontend.on_image(data.draw(mutated(good['image']))))


@MANY
@given(data=st.data())
def test_mutated_compressed_images(vehicle, good, data):
    vehicle.clean()
    message = data.draw(mutated(good['compressed']))
    vehicle.judge(vehicle.frontend.on_compressed_image(message))


@MANY
@given(data=st.data())
def test_mutated_camera_infos(vehicle, good, data):
    vehicle.clean()
    vehicle.frontend.on_camera_info(data.draw(mutated(good['camera_info'])))
    vehicle.judge(vehicle.frontend.on_image(vehicle.image(START + STEP)))


@MANY
@given(data=st.data())
def test_mutated_odometry(vehicle, good, data):
    vehicle.clean()
    vehicle.frontend.on_image(vehicle.image(START))
    vehicle.frontend.on_odometry(good['odometry'])
    vehicle.frontend.on_odometry(data.draw(mutated(good['odometry'])))
    vehicle.judge(vehicle.frontend.on_image(vehicle.image(START + STEP)))


@MANY
@given(data=st.data())
def test_mutated_initial_poses(vehicle, good, data):
    vehicle.clean()
    vehicle.frontend.on_initial_pose(data.draw(mutated(good['initial_pose'])))
    vehicle.judge(vehicle.frontend.on_image(vehicle.image(START + STEP)))


def test_after_all_that_a_good_frame_is_localized(vehicle):
    vehicle.clean()
    estimate = vehicle.frontend.on_image(vehicle.image(START + 100 * S))
    assert estimate.published, estimate.reason
    vehicle.judge(estimate)
