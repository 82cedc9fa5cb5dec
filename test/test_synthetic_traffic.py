# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Cars where the camera would see them, and weather that only adds what it should."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.pose import Pose2
from gip_localizer.synthetic.traffic import Car, cars_hiding, draw_cars, hidden_share
from gip_localizer.synthetic.weather import add_glare, add_rain, add_shadows

K = np.array([[225.0, 0, 159.5], [0, 225.0, 89.5], [0, 0, 1.0]])
BARREL = np.array([-0.3, 0.08, 0.0, 0.0, 0.0])


@pytest.fixture(params=[np.zeros(0), BARREL], ids=['plain', 'barrel'])
def camera(request):
    return CameraModel(Calibration(320, 180, K, request.param), Extrinsics(pitch=0.26))


def draw(camera, *cars):
    scene = np.full((180, 320), 0.5, np.float32)
    return scene, draw_cars(scene, camera, cars)


def test_car_hides_its_projection_and_no_more(camera):
    car = Car(Pose2(10.0, 0.5, 0.2))
    _, hidden = draw(camera, car)
    rng = np.random.default_rng(0)
    inside = rng.uniform(-0.5, 0.5, (3000, 3)) * [car.length, car.width, car.height - 0.15]
    points = np.column_stack([car.pose.transform(inside[:, :2]), inside[:, 2] + 0.825])
    uv, valid = camera.project(points)
    assert valid.all()
    col, row = np.round(uv).astype(int).T
    seen = (col >= 0) & (col < 320) & (row >= 0) & (row < 180)
    assert hidden[row[seen], col[seen]].mean() > 0.99
    hull_area = (uv[:, 0].max() - uv[:, 0].min()) * (uv[:, 1].max() - uv[:, 1].min())
    assert hidden.sum() < 1.15 * hull_area


def test_shadow_darkens_the_road_that_stays_visible(camera):
    scene, hidden = draw(camera, Car(Pose2(10.0, 0.0, 0.0)))
    uv, _ = camera.project(np.array([[7.6, 0.0, 0.0]]))
    col, row = np.round(uv[0]).astype(int)
    assert not hidden[row, col]
    assert scene[row, col] < 0.4


def test_nearer_car_covers_the_farther(camera):
    near, far = Car(Pose2(8.0, 0.0, 0.0), grey=0.9), Car(Pose2(14.0, 0.0, 0.0), grey=0.1)
    one, _ = draw(camera, near, far)
    other, _ = draw(camera, far, near)
    assert np.array_equal(one, other)
    uv, _ = camera.project(np.array([[5.8, 0.0, 0.5]]))
    col, row = np.round(uv[0]).astype(int)
    assert one[row, col] > 0.4


def test_car_behind_is_not_seen_and_one_beside_is_cut_off(camera):
    scene, hidden = draw(camera, Car(Pose2(-6.0, 0.0, 0.0)))
    assert not hidden.any()
    assert np.all(scene == 0.5)
    _, neighbour = draw(camera, Car(Pose2(2.5, 2.6, 0.0)))
    assert neighbour[:, :60].any()
    assert not neighbour[:, 200:].any()


@pytest.mark.parametrize('share', [0.1, 0.25])
def test_traffic_hides_about_what_is_asked(camera, share):
    cars = cars_hiding(camera, share, np.random.default_rng(7))
    assert hidden_share(camera, cars) == pytest.approx(share, abs=0.05)
    again = cars_hiding(camera, share, np.random.default_rng(7))
    assert cars == again


def test_glare_brightens_most_where_the_sun_stands():
    scene = np.full((180, 320), 0.3, np.float32)
    add_glare(scene, 0.4, 0.75)
    assert scene.min() > 0.3
    assert scene[20:60].mean(axis=0).argmax() == pytest.approx(240, abs=3)


def test_shadows_take_their_share_from_strips_reproducibly():
    scenes = [np.ones((360, 640), np.float32) for _ in range(2)]
    for scene in scenes:
        add_shadows(scene, 0.4, np.random.default_rng(3))
    np.testing.assert_array_equal(*scenes)
    lit, dark = (np.isclose(scenes[0], value, atol=1e-3).mean() for value in (1.0, 0.6))
    assert lit > 0.1
    assert dark > 0.1
    assert lit + dark > 0.8


def test_rain_darkens_and_streaks_reproducibly():
    scenes = [np.full((180, 320), 0.5, np.float32) for _ in range(2)]
    for scene in scenes:
        add_rain(scene, 1.0, np.random.default_rng(3))
    assert np.array_equal(*scenes)
    assert np.median(scenes[0]) == pytest.approx(0.43, abs=1e-3)
    assert scenes[0].max() > 0.5
