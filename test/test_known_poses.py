# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A frame rendered at a known pose is found from anywhere inside the search window."""

from __future__ import annotations

from functools import cache
import math

from camera_samples import intrinsics, make_calibration, make_camera
import cv2
from hypothesis import example, given, settings
from hypothesis import strategies as st
import numpy as np
import pytest
from road_samples import ORIGIN, PARAMETERS, Road

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.parameters import Parameters
from gip_localizer.synthetic.renderer import Renderer

HALF_CELL = 0.5 * PARAMETERS.birdseye.resolution
HALF_STEP = 0.5 * PARAMETERS.search.yaw_step
WINDOW = (PARAMETERS.search.x, PARAMETERS.search.y, PARAMETERS.search.yaw)
VAGUE = np.diag([0.35**2, 0.35**2, 0.035**2])  # twice this is no wider than the window
CORNERS = [(1, 1, 1), (-1, -1, -1)]


class Finder:
    """A localizer with a clock of its own that is asked again and again."""

    def __init__(self, road: Road, camera: CameraModel, image: np.ndarray, truth: Pose2,
                 parameters: Parameters = PARAMETERS) -> None:
        self.localizer = Localizer(road.map, parameters)
        self.camera, self.image, self.truth, self.stamp = camera, image, truth, 0

    def from_start(self, start: tuple[float, float, float]) -> None:
        """Start off by shares of the window, and demand the truth."""
        offset = Pose2(*(share * half for share, half in zip(start, WINDOW, strict=True)))
        self.localizer.set_prior(0, self.truth @ offset.inverse(), VAGUE)
        self.stamp += 1_000_000_000
        estimate = self.localizer.update(self.stamp, self.image, self.camera)
        assert estimate.published, (start, estimate.reason)
        d = difference(estimate.pose, self.truth)
        assert math.hypot(d[0], d[1]) < HALF_CELL, (start, d)
        assert abs(d[2]) < HALF_STEP, (start, d)

    def from_corners(self) -> None:
        for start in CORNERS:
            self.from_start(start)


@cache
def finder_of(road: Road, lens: str, metric: str) -> Finder:
    focal = 300.0 if lens == 'equidistant' else 450.0
    camera, truth = make_camera(lens, focal=focal), road.pose(0.1)
    parameters = PARAMETERS.replace({'score.metric': metric})
    return Finder(road, camera, road.frame(camera, truth), truth, parameters)


@settings(max_examples=14)
@example(start=(1.0, -1.0, 0.0))
@given(start=st.tuples(*[st.floats(-1.0, 1.0)] * 3))
def test_from_any_start_in_the_window(road, start):
    assert ORIGIN.yaw != 0.0
    finder_of(road, 'plumb_bob', 'gip_normalized').from_start(start)


@pytest.mark.parametrize('lens', ['rational-8', 'equidistant'])
def test_through_other_lenses(road, lens):
    finder_of(road, lens, 'gip_normalized').from_corners()


@pytest.mark.parametrize('metric', ['gip', 'euclidean', 'euclidean_normalized'])
def test_by_every_metric(road, metric):
    finder_of(road, 'plumb_bob', metric).from_corners()


@pytest.mark.parametrize('share', [0.3, 0.55, 0.8])
def test_at_other_places(road, share):
    camera, truth = make_camera('plumb_bob'), road.pose(share) @ Pose2(0.013, 0.2, 0.04)
    Finder(road, camera, road.frame(camera, truth), truth).from_corners()


@pytest.mark.parametrize(('gain', 'offset', 'noise'), [
    (0.15, 0.0, 0.004), (0.4, 0.3, 0.01), (1.6, -0.1, 0.02),
])
def test_whatever_the_exposure(road, gain, offset, noise):
    camera, truth = make_camera('plumb_bob'), road.pose(0.1)
    image = road.frame(camera, truth, gain=gain, offset=offset, noise=noise)
    Finder(road, camera, image, truth).from_corners()


def test_in_sixteen_bits(road):
    camera, truth = make_camera('plumb_bob'), road.pose(0.1)
    image = road.frame(camera, truth, bits=16, gain=0.05, noise=0.0005)
    assert image.dtype == np.uint16
    Finder(road, camera, image, truth).from_corners()


def test_in_an_image_that_opencv_rectified(road):
    truth, P = road.pose(0.1), intrinsics(420.0, 640, 360)
    calibration = make_calibration('plumb_bob', P=P)
    raw = road.frame(make_camera('plumb_bob'), truth)
    maps = cv2.initUndistortRectifyMap(
        calibration.K, calibration.D, np.eye(3), P, (640, 360), cv2.CV_32FC1
    )
    image = cv2.remap(raw, *maps, cv2.INTER_LINEAR)
    camera = CameraModel(calibration, make_camera().extrinsics, rectified=True)
    Finder(road, camera, image, truth).from_corners()


def test_in_a_binned_region_of_interest(road):
    # Pixels of the full image are cut and averaged here, not by the camera model.
    x, y, width, height = roi = (64, 60, 1152, 600)
    truth = road.pose(0.1)
    full = make_camera('plumb_bob', size=(1280, 720), focal=900.0)
    scene = Renderer(road.raster, full).render(truth)[y : y + height, x : x + width]
    binned = scene.reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))
    image = (np.clip(binned, 0.0, 1.0) * 255).astype(np.uint8)
    whole = full.calibration
    calibration = Calibration(1280, 720, whole.K, whole.D, roi=roi, binning=(2, 2))
    camera = CameraModel(calibration, full.extrinsics)
    assert (camera.width, camera.height) == image.shape[::-1]
    Finder(road, camera, image, truth).from_corners()


@pytest.mark.parametrize('held', [
    Extrinsics(2.0, -0.8, 1.2, -0.06, 0.35, -0.3), Extrinsics(-0.5, 0.5, 2.4, 0.08, 0.3, 0.25),
])
def test_however_the_camera_is_held(road, held):
    camera, truth = make_camera('plumb_bob', held=held), road.pose(0.1)
    Finder(road, camera, road.frame(camera, truth), truth).from_corners()


def test_a_camera_that_looks_back(road):
    held = Extrinsics(-1.0, 0.1, 1.5, 0.02, 0.26, math.pi - 0.1)
    camera, truth = make_camera('plumb_bob', held=held), road.pose(0.1)
    behind = PARAMETERS.replace({'birdseye.near': -10.0, 'birdseye.far': -3.0})
    Finder(road, camera, road.frame(camera, truth), truth, behind).from_corners()
