# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera frame with the map drawn in: the lines lie where the paint is seen."""

from __future__ import annotations

from camera_samples import HELD, make_camera
import cv2
import numpy as np
import pytest
from test_frontend import S
from test_mask import localized

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.visualization.overlay import camera_overlay, map_outlines, PUBLISHED, WITHHELD

CAMERA = make_camera('plumb_bob')
GRID = Grid(9.0, 3.0, 60, 60, 0.1)
BASE = Pose2(10.0, 10.0, 0.0)
BAR = (5.0, 7.0, -0.5, 0.5)
"""Of paint in the base frame: from and to x, from and to y, metres."""


def barred(known=None):
    """A dark road of 20 x 20 m with one bright bar ahead of BASE."""
    grey = np.full((400, 400), 40, np.uint8)
    x0, x1, y0, y1 = BAR
    rows = [round((20.0 - (10.0 + y)) / 0.05) for y in (y1, y0)]
    cols = [round((10.0 + x) / 0.05) for x in (x0, x1)]
    grey[slice(*rows), slice(*cols)] = 220
    return RasterMap(grey, 0.05, Pose2(0.0, 0.0, 0.0), known)


def from_edge(points):
    """Distance of base points from the outline of the bar, metres."""
    x0, x1, y0, y1 = BAR
    dx = np.maximum(x0 - points[:, 0], points[:, 0] - x1)
    dy = np.maximum(y0 - points[:, 1], points[:, 1] - y1)
    return np.abs(np.maximum(dx, dy))


def coloured(picture, colour):
    """Pixels of that hue, as bright as they may be where a line is thinner than a pixel."""
    tint = picture - picture.mean(axis=2, keepdims=True)
    wanted = np.array(colour) - np.mean(colour)
    return tint @ wanted / (wanted @ wanted) > 0.3


def test_outlines_are_those_of_the_paint():
    lines = map_outlines(barred(), GRID, BASE)
    points = np.vstack(lines)
    assert from_edge(points).max() < 0.1
    length = sum(np.hypot(*np.diff(line, axis=0).T).sum() for line in lines)
    assert length == pytest.approx(6.0, rel=0.25)
    turned = map_outlines(barred(), GRID, BASE @ Pose2(0.0, 0.0, 0.3))
    back = Pose2(0.0, 0.0, 0.3).transform(np.vstack(turned))
    assert from_edge(back).max() < 0.12


def test_outlines_end_where_the_known_map_does():
    known = np.ones((400, 400), bool)
    known[:200] = False  # left of the base
    points = np.vstack(map_outlines(barred(known), GRID, BASE))
    assert points[:, 1].max() < 0.1
    known[:] = False
    assert map_outlines(barred(known), GRID, BASE) == []


@pytest.fixture(scope='module')
def frame(road):
    truth = road.pose(0.1)
    pixels = road.frame(CAMERA, truth)
    return truth, pixels, localized(road, truth, pixels, calibration=CAMERA.calibration)


def test_lines_lie_on_the_edges_of_the_picture(road, frame):
    _, pixels, estimate = frame
    camera = CameraModel(CAMERA.calibration, HELD)
    picture = camera_overlay(pixels, camera, road.map, estimate)
    assert picture.shape == (*pixels.shape, 3)
    lines = coloured(picture, PUBLISHED)
    lines[-60:], lines[:110, -110:] = False, False  # text and likelihood
    assert lines.sum() > 200
    smooth = cv2.GaussianBlur(pixels.astype(np.float32), (0, 0), 1.5)
    steps = np.hypot(*np.gradient(smooth))
    assert np.median(steps[lines]) > 3.0 * np.median(steps[pixels.shape[0] // 2:])


def test_what_is_withheld_has_another_colour(road, frame):
    _, pixels, estimate = frame
    withheld = Estimate(S, Status.AMBIGUOUS, 'two places', match=estimate.match)
    picture = camera_overlay(pixels, CAMERA, road.map, withheld)
    road_only = picture[110:-60]
    assert coloured(road_only, WITHHELD).sum() > 200
    assert not coloured(road_only, PUBLISHED).any()


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize('shape', [(1, 1), (7, 5), (360, 640)])
def test_a_frame_without_a_match_is_shown_with_its_status(road, dtype, shape):
    scale = {np.uint8: 255, np.uint16: 4000, np.float32: 1.0}[dtype]
    image = (np.random.default_rng(0).random(shape) * scale).astype(dtype)
    estimate = Estimate(S, Status.NO_PRIOR, 'no prior yet')
    picture = camera_overlay(image, None, road.map, estimate)
    assert picture.shape == (*shape, 3)
    assert picture.dtype == np.uint8
