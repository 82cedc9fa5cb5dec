# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The view that is chosen for a camera: inside the image, of useful cells, few enough."""

import math

import numpy as np
import pytest

from gip_localizer.core.birdseye.footprints import footprint_areas
from gip_localizer.core.birdseye.rectifier import make_grid, Rectifier
from gip_localizer.core.birdseye.view_choice import (
    choose_view,
    COARSEST,
    complete_view,
    LEAST_PIXELS,
    MOST_CELLS,
    MOST_SLOPE,
)
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.model import CameraModel, Extrinsics
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye

RIGHT_ANGLE = 0.5 * math.pi


def camera(width=1280, height=720, focal=900.0, model='plumb_bob', distortion=(), **held):
    K = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0, 0, 1]])
    calibration = Calibration(width, height, K, D=np.array(distortion, float), model=model)
    return CameraModel(calibration, Extrinsics(**held))


CAMERAS = {
    'car': (camera(z=1.5, pitch=0.26), 0.05),
    'car, nearly level': (camera(1241, 376, 718.0, z=1.65, pitch=0.017), 0.05),
    'car, distorted': (camera(distortion=(-0.3, 0.08, 0, 0, 0), z=1.5, pitch=0.26, roll=0.03,
                              yaw=-0.05, x=1.2, y=0.3), 0.05),
    'small robot': (camera(640, 480, 600.0, z=0.35, pitch=0.44), 0.01),
    'truck': (camera(z=2.5, pitch=0.26), 0.05),
    'drone, 8 m': (camera(focal=700.0, z=8.0, pitch=RIGHT_ANGLE), 0.05),
    'drone, 30 m': (camera(z=30.0, pitch=RIGHT_ANGLE), 0.05),
    'fisheye': (camera(1280, 960, 350.0, 'equidistant', (0.01, 0, 0, 0), z=1.2, pitch=0.35), 0.05),
    'rear': (camera(focal=700.0, x=-1.0, z=1.0, pitch=0.5, yaw=math.pi), 0.05),
    'side': (camera(focal=700.0, y=0.9, z=1.2, pitch=0.5, yaw=RIGHT_ANGLE), 0.05),
    'upside down': (camera(z=1.5, pitch=0.26, roll=math.pi), 0.05),
    'few pixels': (camera(320, 240, 150.0, z=1.5, pitch=0.35), 0.05),
}
"""Name → camera, and side of a cell of its map (m)."""


@pytest.mark.parametrize('name', CAMERAS)
def test_the_view_holds_useful_road(name):
    device, map_resolution = CAMERAS[name]
    view = choose_view(device, map_resolution)
    area, valid = footprint_areas(device, make_grid(view))
    assert map_resolution <= view.resolution <= 1.05 * COARSEST * map_resolution
    useful = valid & (area >= LEAST_PIXELS)
    # a lateral camera sees a part of one half of a view that is symmetric about base_link
    least = 0.15 if name == 'side' else 0.6
    assert useful.mean() > least
    assert 0.1 * MOST_CELLS < useful.sum() < 1.1 * MOST_CELLS
    distance = np.linalg.norm(make_grid(view).points() - device.extrinsics.position()[:2], axis=1)
    assert np.median(distance) < MOST_SLOPE * device.extrinsics.z
    assert Rectifier(device, view).valid.any()


def test_a_drone_looks_about_the_point_below_it():
    view = choose_view(*CAMERAS['drone, 8 m'])
    assert view.near == pytest.approx(-view.far, abs=2.0 * view.resolution)
    assert view.far == pytest.approx(8.0 * 360 / 700, abs=0.2)


def test_a_rear_camera_looks_behind():
    view = choose_view(*CAMERAS['rear'])
    assert view.near < view.far < -1.0


def test_an_upside_down_camera_sees_as_an_upright_one():
    assert choose_view(*CAMERAS['upside down']) == choose_view(*CAMERAS['car'])


def test_the_cells_are_those_of_a_coarse_map():
    device, _ = CAMERAS['small robot']
    assert choose_view(device, 0.025).resolution == 0.025


def test_given_values_are_kept():
    device, map_resolution = CAMERAS['car']
    full = Birdseye(3.0, 9.0, 2.0, 0.1)
    assert complete_view(full, device, map_resolution) == full
    view = complete_view(Birdseye(far=8.0, resolution=0.1), device, map_resolution)
    assert (view.far, view.resolution) == (8.0, 0.1)
    assert 1.9 < view.near < 2.6


def test_an_edge_on_the_wrong_side_is_refused_with_what_the_camera_sees():
    device, map_resolution = CAMERAS['car']
    with pytest.raises(CalibrationError, match=r'useful road from 2\.\d+ to 1\d'):
        complete_view(Birdseye(near=40.0), device, map_resolution)


@pytest.mark.parametrize('held', [{'pitch': -0.6}, {'pitch': -RIGHT_ANGLE}])
def test_a_camera_that_sees_no_road_is_refused(held):
    with pytest.raises(CalibrationError, match='sees no road'):
        choose_view(camera(**{'z': 1.5, 'pitch': 0.0, **held}), 0.05)
