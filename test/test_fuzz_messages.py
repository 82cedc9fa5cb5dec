# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Mutated messages of every subscribed type: no exception, and no pose that is wrong.

`make fuzz` tries 10,000 of each, none of which may take longer than a second.

"""

from __future__ import annotations

import math
import os

from camera_samples import HELD, make_calibration, make_camera, SMALL_CAMERA
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
from mutations import mutated, mutated_bytes, no_hang
import numpy as np
import pytest

from gip_localizer.core.estimate import Status
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.parameters import Parameters
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.mask_sync import MaskPairing

MANY = settings(max_examples=int(os.environ.get('GIP_FUZZ', '30')))
S = 1_000_000_000
START = 1_700_000_000 * S
STEP = S // 20
PLAUSIBLE = 4.0
"""Pixels by which a calibration may move the road and still be taken for the true one."""
CALIBRATION = make_calibration('plumb_bob', **SMALL_CAMERA)
CAMERA = make_camera('plumb_bob', **SMALL_CAMERA)
COVARIANCE = np.diag([0.1**2, 0.1**2, 0.01**2])
PARAMETERS = Parameters.from_dict({
    'birdseye.near': 3.0, 'birdseye.far': 8.0, 'birdseye.half_width': 2.0,
    'birdseye.resolution': 0.2, 'search.x': 0.4, 'search.y': 0.4, 'search.yaw': 0.03,
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
        self.png = cv2.imencode('.png', self.pixels)[1].tobytes()
        self.mask = np.full(self.pixels.shape, 255, np.uint8)
        self.flat = np.full(self.pixels.shape, 90, np.uint8)
        self.frontend = Frontend(road.map, PARAMETERS)

    def configure(self, **changes):
        self.frontend.configure(PARAMETERS.replace(changes))

    def clean(self):
        """Give it a good calibration and a good prior, at the beginning of time."""
        self.frontend.localizer.state.pose_filter.odometry.clear()
        self.frontend.on_camera_info(camera_info(CALIBRATION))
        for stamp in (START + 1000 * S, START - 100 * S):  # time goes back: all is forgotten
            self.frontend.on_image(image_message(self.flat, 'mono8', stamp_ns=stamp))
        self.frontend.on_initial_pose(initial_pose(self.truth, COVARIANCE))
        assert not {'camera_info', 'initialpose'} & set(self.frontend.complaints)

    def image(self, later=0):
        return image_message(self.pixels, 'mono8', stamp_ns=START + later)

    def odometry(self, later=0):
        return odometry_message(START + later, Pose2(1.0, 2.0, 0.3))

    def see(self, message, masked=None, *, same_camera=True):
        """
        Localize, and judge: a published pose is whole, honest of its uncertainty and right.

        Another camera's calibration cannot be distinguished from the true one: the pose is then
        where that camera would see the road so, and need only be whole.

        """
        with no_hang():
            estimate = self._take(message, masked)
        if estimate.pose is None:
            assert estimate.reason
            return estimate
        self._judge(estimate, same_camera)
        return estimate

    def same_camera(self):
        """Whether the calibration in force shows the road where the true one does."""
        if self.frontend.camera is None:
            return True
        road = np.array([[x, y] for x in (3.0, 5.0, 8.0) for y in (-2.0, 0.0, 2.0)])
        pixels, seen = self.frontend.camera.project(road)
        apart = np.abs(pixels - CAMERA.project(road)[0])
        return bool(np.all(seen & (apart.max(axis=1) < PLAUSIBLE)))

    def _take(self, message, masked):
        compressed = hasattr(message, 'format')
        take = self.frontend.on_compressed_image if compressed else self.frontend.on_image
        return take(message, masked)

    def _judge(self, estimate, same_camera):
        assert all(math.isfinite(value) for value in estimate.pose)
        assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0
        apart = difference(estimate.pose, self.truth)
        assert math.hypot(apart[0], apart[1]) < 0.5 or not same_camera
        assert abs(apart[2]) < math.radians(2.0) or not same_camera


@pytest.fixture(scope='module')
def vehicle(road):
    return Vehicle(road)


@pytest.fixture(autouse=True)
def _good_frames_are_published_before_and_after(vehicle):
    """What is tried in between is tried on a localizer that works."""
    vehicle.clean()
    assert vehicle.see(vehicle.image()).published
    yield
    vehicle.configure()
    vehicle.clean()
    assert vehicle.see(vehicle.image()).published


@MANY
@given(data=st.data())
def test_mutated_images(vehicle, data):
    vehicle.clean()
    vehicle.see(data.draw(mutated(vehicle.image())))


@MANY
@given(data=st.data(), kind=st.sampled_from(['jpeg', 'png']))
def test_mutated_compressed_images(vehicle, data, kind):
    vehicle.clean()
    content = getattr(vehicle, kind)
    if data.draw(st.booleans()):
        content = data.draw(mutated_bytes(content))
        message = compressed_message(content, kind, stamp_ns=START)
    else:
        message = data.draw(mutated(compressed_message(content, kind, stamp_ns=START)))
    vehicle.see(message)


@pytest.mark.parametrize('required', [False, True])
def test_mutated_masks(vehicle, required):
    vehicle.configure(**{'mask.required': required})
    try_masks(vehicle)


@MANY
@given(data=st.data())
def try_masks(vehicle, data):
    vehicle.clean()
    message = image_message(vehicle.mask, 'mono8', stamp_ns=START)
    mask = data.draw(mutated(message))
    pairing = MaskPairing(lambda: vehicle.frontend.parameters.mask)
    found = [pairing.add_image(vehicle.image(), 0), pairing.add_mask(mask), *pairing.flush()]
    [masked] = [pair for pair in found if pair is not None]
    estimate = vehicle.see(masked.image, masked)
    assert estimate.published or estimate.status in (Status.NO_MASK, Status.LOW_CONTRAST,
                                                     Status.NO_MATCH, Status.UNCERTAIN,
                                                     Status.AMBIGUOUS, Status.LOW_OVERLAP)


@MANY
@given(data=st.data())
def test_mutated_camera_infos(vehicle, data):
    vehicle.clean()
    message = data.draw(mutated(camera_info(CALIBRATION)))
    with no_hang():
        vehicle.frontend.on_camera_info(message)
    vehicle.see(vehicle.image(), same_camera=vehicle.same_camera())


@MANY
@given(data=st.data())
def test_mutated_odometry(vehicle, data):
    vehicle.clean()
    vehicle.frontend.on_odometry(vehicle.odometry())
    assert vehicle.see(vehicle.image()).published
    vehicle.frontend.on_odometry(data.draw(mutated(vehicle.odometry(STEP))))
    vehicle.see(vehicle.image(2 * STEP))
    vehicle.frontend.on_odometry(vehicle.odometry(3 * STEP))
    vehicle.see(vehicle.image(3 * STEP))


@MANY
@given(data=st.data())
def test_mutated_initial_poses(vehicle, data):
    vehicle.clean()
    vehicle.frontend.on_initial_pose(data.draw(mutated(initial_pose(vehicle.truth, COVARIANCE))))
    vehicle.see(vehicle.image(STEP))
