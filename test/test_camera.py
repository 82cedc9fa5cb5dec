# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import math

from camera_samples import HELD, intrinsics, LENSES, make_calibration, make_camera
import cv2
from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import CalibrationError

PIXEL_TOLERANCE = 0.01
ROAD = np.stack(
    np.meshgrid(np.linspace(3.0, 25.0, 23), np.linspace(-3.0, 3.0, 13)), axis=-1
).reshape(-1, 2)


def optical_from_base(held: Extrinsics) -> tuple[np.ndarray, np.ndarray]:
    """Rotation vector and translation for OpenCV, without the package's own matrices."""
    R_base_body = Rotation.from_euler('ZYX', [held.yaw, held.pitch, held.roll]).as_matrix()
    R_body_optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    R = (R_base_body @ R_body_optical).T
    return R, -R @ np.array([held.x, held.y, held.z])


def projected(calibration: Calibration, held: Extrinsics, xy: np.ndarray) -> np.ndarray:
    """Pixels of road points in the full raw image, by OpenCV from end to end."""
    R, t = optical_from_base(held)
    points = np.column_stack([xy, np.zeros(len(xy))]) @ R.T + t
    zero = np.zeros(3)
    if calibration.model == 'equidistant':
        uv, _ = cv2.fisheye.projectPoints(points[None], zero, zero, calibration.K, calibration.D)
    else:
        uv, _ = cv2.projectPoints(points[:, None], zero, zero, calibration.K, calibration.D)
    return uv.reshape(-1, 2)


@pytest.mark.parametrize('lens', LENSES)
def test_road_points_fall_on_the_pixels_that_opencv_says(lens):
    camera = make_camera(lens)
    uv, valid = camera.project(ROAD)
    expected = projected(camera.calibration, HELD, ROAD)
    assert valid.all()
    assert np.abs(uv - expected).max() < PIXEL_TOLERANCE
    assert (np.abs(uv - expected).max() > 0.0) or lens == 'none'  # the paths differ
    inside = (np.abs(expected - [319.5, 179.5]) < [320.0, 180.0]).all(axis=1)
    assert inside.sum() > 100
    back, on_road = camera.road_points(expected[inside])
    assert on_road.all()
    np.testing.assert_allclose(back, ROAD[inside], atol=1e-4)


@pytest.mark.parametrize('lens', ['plumb_bob', 'equidistant'])
def test_binning_and_roi_shift_and_join_pixels(lens):
    roi, binning = (64, 40, 480, 300), (2, 3)
    camera = make_camera(lens, roi=roi, binning=binning)
    assert (camera.width, camera.height) == (240, 100)
    full = projected(camera.calibration, HELD, ROAD)
    # pixel j of the delivered image joins pixels j·b … j·b + b - 1 of the region
    expected = (full - roi[:2] - (np.array(binning) - 1) / 2) / binning
    uv, valid = camera.project(ROAD)
    assert valid.all()
    assert np.abs(uv - expected).max() < PIXEL_TOLERANCE


@pytest.mark.parametrize('binning', [(1, 1), (2, 2)])
def test_a_rectified_image_obeys_p_and_r_and_no_distortion(binning):
    R_rect = Rotation.from_euler('xyz', [0.01, -0.02, 0.03]).as_matrix()
    P = intrinsics(400.0, 640, 360) + np.array([[0, 0, 5.0], [0, 0, -3.0], [0, 0, 0]])
    camera = make_camera('plumb_bob', rectified=True, P=P, R=R_rect, binning=binning)
    R, t = optical_from_base(HELD)
    points = (np.column_stack([ROAD, np.zeros(len(ROAD))]) @ R.T + t) @ R_rect.T
    expected, _ = cv2.projectPoints(points[:, None], np.zeros(3), np.zeros(3), P, np.zeros(5))
    expected = (expected.reshape(-1, 2) - (np.array(binning) - 1) / 2) / binning
    uv, valid = camera.project(ROAD)
    assert valid.all()
    assert np.abs(uv - expected).max() < PIXEL_TOLERANCE


def test_raw_pixels_rectified_by_opencv_are_the_rectified_camera_s():
    P = intrinsics(420.0, 640, 360)
    calibration = make_calibration('plumb_bob', P=P)
    raw = projected(calibration, HELD, ROAD)
    K, D = calibration.K, calibration.D
    rectified = cv2.undistortPoints(raw[:, None], K, D, R=np.eye(3), P=P).reshape(-1, 2)
    uv, _ = CameraModel(calibration, HELD, rectified=True).project(ROAD)
    near = np.abs(raw - [320, 180]).max(axis=1) < 200  # OpenCV's five iterations suffice here
    assert near.sum() > 50
    assert np.abs(uv - rectified)[near].max() < PIXEL_TOLERANCE


@given(
    st.sampled_from(sorted(LENSES)), st.floats(-0.2, 0.2), st.floats(0.05, 1.2),
    st.floats(-3.0, 3.0), st.floats(0.2, 4.0), st.integers(0, 2**31),
)
def test_pixels_come_back_from_the_road(lens, roll, pitch, yaw, height, seed):
    camera = make_camera(lens, held=Extrinsics(0.5, -0.2, height, roll, pitch, yaw))
    uv = np.random.default_rng(seed).uniform([-0.5, -0.5], [639.5, 359.5], (50, 2))
    xy, on_road = camera.road_points(uv)
    assert np.isnan(xy[~on_road]).all()
    back, seen = camera.project(xy[on_road])
    assert seen.all()
    np.testing.assert_allclose(back, uv[on_road], atol=0.02)


@pytest.mark.parametrize('lens', sorted(LENSES))
def test_the_road_goes_through_one_homography_which_is_the_projection_of_points(lens):
    camera = make_camera(lens, held=Extrinsics(0.5, -0.2, 1.4, 0.02, 0.3, -0.1))
    uv, valid = camera.project(ROAD)
    expected, seen = camera.project(np.column_stack([ROAD, np.zeros(len(ROAD))]))
    np.testing.assert_array_equal(valid, seen)
    np.testing.assert_allclose(uv[valid], expected[seen], atol=1e-8)
    both = camera.H_road_image @ camera.H_image_road
    np.testing.assert_allclose(both, -1.4 * np.eye(3), atol=1e-12)


@pytest.mark.parametrize('height', [0.0, 1e-9])
def test_a_camera_on_the_road_sees_no_footprints(height):
    camera = make_camera(held=Extrinsics(z=height, pitch=0.2))
    assert np.isfinite(camera.H_road_image).all()
    assert camera.project(ROAD)[0].shape == ROAD.shape


def test_nothing_is_on_the_road_above_the_horizon():
    camera = make_camera(held=Extrinsics(z=1.5, pitch=0.1))
    horizon = camera.K[1, 2] - 450.0 * math.tan(0.1)
    columns = np.linspace(0.0, 639.0, 20)
    above = np.column_stack([columns, np.full(20, horizon - 2.0)])
    below = np.column_stack([columns, np.full(20, horizon + 5.0)])
    assert not camera.road_points(above)[1].any()
    assert camera.road_points(below)[1].all()


def test_a_camera_that_looks_up_sees_no_road():
    camera = make_camera(held=Extrinsics(z=1.5, pitch=-0.8))
    uv = np.stack(np.meshgrid(np.arange(0, 640, 40), np.arange(0, 360, 40)), -1).reshape(-1, 2)
    assert not camera.road_points(uv.astype(float))[1].any()


def test_points_behind_the_camera_have_no_pixel():
    camera = make_camera('plumb_bob')
    uv, valid = camera.project(np.array([[-5.0, 0.0, 0.0], [0.0, 0.0, 1.5], [5.0, 0.0, 0.0]]))
    assert valid.tolist() == [False, False, True]
    assert np.isnan(uv[:2]).all()
    assert np.isfinite(uv[2]).all()


def test_no_points_are_no_pixels():
    camera = make_camera('equidistant')
    assert camera.project(np.zeros((0, 2)))[0].shape == (0, 2)
    assert camera.road_points(np.zeros((0, 2)))[0].shape == (0, 2)


def test_rays_beyond_the_fold_of_a_lens_are_refused():
    # r (1 - 0.3 r²) grows up to r² = 1/0.9 and then comes back into the image
    K = intrinsics(100.0, 640, 360)
    fold = math.sqrt(1.0 / 0.9)
    calibration = Calibration(640, 360, K, np.array([-0.3, 0.0, 0.0, 0.0]))
    camera = CameraModel(calibration, Extrinsics(z=1.0, pitch=math.pi / 2))
    assert camera.max_radius == pytest.approx(fold, rel=0.01)
    # straight down from 1 m: a road point at distance r from the foot has radius r
    angle = np.linspace(0.0, 6.0, 9)
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    assert camera.project(0.98 * fold * ring)[1].all()
    for radius in (1.02, 1.3, 1.7):
        assert not camera.project(radius * fold * ring)[1].any()
    rim = 100.0 * fold * (1 - 0.3 * fold**2)
    assert not camera.road_points(K[:2, 2] + (rim + 2.0) * ring)[1].any()


@pytest.mark.parametrize('D', [np.zeros(0), np.zeros(4), np.zeros(5)])
def test_an_ideal_fisheye_is_no_pinhole(D):
    K = intrinsics(200.0, 640, 360)
    ideal = CameraModel(Calibration(640, 360, K, D, model='equidistant'), HELD)
    bent = np.array([1e-12, 0.0, 0.0, 0.0])
    nearly = CameraModel(Calibration(640, 360, K, bent, model='equidistant'), HELD)
    points = np.array([[4.0, 2.5], [3.0, -1.0], [8.0, 0.0]])
    seen, valid = ideal.project(points)
    assert valid.all()
    np.testing.assert_allclose(seen, nearly.project(points)[0], atol=1e-6)
    pinhole = CameraModel(Calibration(640, 360, K), HELD)
    assert np.abs(seen - pinhole.project(points)[0]).max() > 5.0
    back, on_road = ideal.road_points(seen)
    assert on_road.all()
    np.testing.assert_allclose(back, points, atol=1e-5)


def test_a_fisheye_fold_is_refused():
    D = np.array([-0.3, 0.0, 0.0, 0.0])  # θ (1 - 0.3 θ²) folds at θ = 1.054
    calibration = Calibration(640, 360, intrinsics(100.0, 640, 360), D, model='equidistant')
    camera = CameraModel(calibration, Extrinsics(z=1.0, pitch=math.pi / 2))
    assert camera.max_radius == pytest.approx(math.tan(math.sqrt(1.0 / 0.9)), rel=0.01)


def test_the_key_tells_every_difference():
    base = make_camera('plumb_bob')
    assert base.key() == make_camera('plumb_bob').key()
    others = [
        make_camera('plumb_bob', held=replace(HELD, yaw=0.051)),
        make_camera('plumb_bob', focal=451.0),
        make_camera('none'),
        make_camera('plumb_bob', binning=(2, 2)),
        base.for_image(np.zeros((360, 639), np.uint8)),
        base.with_extrinsics(replace(HELD, z=1.6)),
    ]
    keys = {camera.key() for camera in [base, *others]}
    assert len(keys) == len(others) + 1


K0 = intrinsics(450.0, 640, 360)
NAN = np.full((3, 3), np.nan)


@pytest.mark.parametrize(('change', 'word'), [
    ({'K': np.zeros((3, 3))}, 'not calibrated'),
    ({'K': NAN}, 'NaN'),
    ({'D': np.array([0.1, np.inf, 0.0, 0.0, 0.0])}, 'NaN or infinity'),
    ({'P': NAN}, 'NaN'),
    ({'R': NAN}, 'NaN'),
    ({'K': np.diag([-450.0, 450.0, 1.0])}, 'not calibrated'),
    ({'width': 0}, 'size'),
    ({'height': -3}, 'size'),
    ({'model': 'mei', 'D': np.ones(4)}, "'mei'"),
    ({'model': 'plumb_bob', 'D': np.ones(3)}, '3 numbers'),
    ({'model': 'equidistant', 'D': np.ones(5)}, '5 numbers'),
    ({'model': 'rational_polynomial', 'D': np.ones(5)}, '5 numbers'),
    ({'roi': (600, 0, 100, 100)}, 'roi'),
    ({'roi': (-1, 0, 100, 100)}, 'roi'),
])
def test_unusable_calibrations_are_refused(change, word):
    numbers = {'width': 640, 'height': 360, 'K': K0, **change}
    with pytest.raises(CalibrationError, match=word):
        Calibration(**numbers)


@pytest.mark.parametrize('D', [np.zeros(0), np.zeros(5), np.zeros(7)])
def test_no_distortion_needs_no_model(D):
    camera = CameraModel(Calibration(640, 360, K0, D, model=''), HELD)
    assert np.abs(camera.project(ROAD)[0] - make_camera().project(ROAD)[0]).max() == 0.0


def test_a_rectified_camera_needs_p():
    with pytest.raises(CalibrationError, match='P has focal lengths 0'):
        CameraModel(make_calibration(), HELD, rectified=True)
