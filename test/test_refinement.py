# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import math

from camera_samples import HELD, make_camera
import numpy as np
import pytest

from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.gramian import gramian
from gip_localizer.core.map.crop import Crop
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.covariance_parts import mount_covariance
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.refine.robust import outlier_scale
from gip_localizer.parameters import Birdseye, CameraMotion

FIXED = CameraMotion(0.0, 0.0, 0.0)
CAMERA = make_camera('plumb_bob')
RECTIFIER = Rectifier(CAMERA, Birdseye(3.0, 10.0, 3.0, 0.05))
STARTS = [Pose2(0.15, -0.1, 0.005), Pose2(-0.1, 0.15, -0.008), Pose2(0.0, 0.0, 0.0)]


def fit(road, image, start, *, refiner=None, noise=0.01, **kwargs):
    refiner = refiner or Refiner(RECTIFIER, FIXED, normalized=True, robust=True)
    view = RECTIFIER.rectify(image)
    weight = gramian(view.footprint, pixel_noise=noise, map_noise=0.02)
    crop = road.map.crop(start.transform(RECTIFIER.grid.corners()), margin=1.5, cell=0.05)
    return refiner.refine(refiner.layers(view, weight, Crop(crop, 0.05)), start, **kwargs)


def assert_near(pose, truth, *, xy=0.02, yaw=0.002):
    d = difference(pose, truth)
    assert math.hypot(d[0], d[1]) < xy, d
    assert abs(d[2]) < yaw, d


@pytest.mark.parametrize('start', STARTS)
@pytest.mark.parametrize('robust', [False, True])
@pytest.mark.parametrize('normalized', [False, True])
def test_nearby_starts_end_at_the_truth(road, start, robust, normalized):
    truth = road.pose(0.1)
    refiner = Refiner(RECTIFIER, FIXED, normalized=normalized, robust=robust)
    found = fit(road, road.frame(CAMERA, truth), truth @ start, refiner=refiner)
    assert found.converged
    assert_near(found.pose, truth)
    assert found.correlation > 0.9
    assert found.overlap == pytest.approx(1.0, abs=1e-3)


def test_the_end_does_not_depend_on_the_start(road):
    truth = road.pose(0.3)
    image = road.frame(CAMERA, truth)
    ends = [fit(road, image, truth @ start).pose for start in STARTS]
    for end in ends[1:]:
        assert_near(end, ends[0], xy=0.002, yaw=2e-4)


@pytest.mark.parametrize(('gain', 'offset'), [(0.3, 0.1), (0.8, 0.0), (1.2, -0.05)])
def test_gain_and_offset_are_estimated(road, gain, offset):
    truth = road.pose(0.1)
    image = road.frame(CAMERA, truth, gain=gain, offset=offset, bits=16)
    found = fit(road, image, truth @ STARTS[0])
    assert_near(found.pose, truth)
    assert found.gain == pytest.approx(gain, rel=0.05)
    assert found.offset == pytest.approx(offset, abs=0.03)


def test_covariances_are_covariances_and_noise_makes_them_larger(road):
    truth = road.pose(0.1)
    sharp, noisy = (
        fit(road, road.frame(CAMERA, truth, noise=noise, bits=16), truth, noise=noise)
        for noise in (0.005, 0.1)
    )
    for found in (sharp, noisy):
        for matrix in (found.covariance, found.fisher):
            np.testing.assert_allclose(matrix, matrix.T, atol=1e-12)
            assert np.linalg.eigvalsh(matrix)[0] > 0.0
    assert np.trace(noisy.fisher) > 2.0 * np.trace(sharp.fisher)
    assert noisy.covariance[0, 0] > sharp.covariance[0, 0]


def test_a_pitch_of_the_suspension_is_estimated(road):
    truth, swing = road.pose(0.1), 0.006
    moved = CAMERA.with_extrinsics(replace(HELD, pitch=HELD.pitch + swing))
    image = road.frame(moved, truth)
    refiner = Refiner(RECTIFIER, CameraMotion(0.005, 0.003, 0.003), normalized=True, robust=True)
    free = fit(road, image, truth, refiner=refiner)
    fixed = fit(road, image, truth)
    assert free.camera_motion[0] == pytest.approx(swing, abs=0.0015)
    assert_near(free.pose, truth, xy=0.03)
    assert np.abs(difference(free.pose, truth)[:2]).max() < (
        0.7 * np.abs(difference(fixed.pose, truth)[:2]).max()
    )
    assert not fixed.camera_motion.any()


def test_a_car_on_the_road_is_left_out(road):
    truth = road.pose(0.1)
    image = road.frame(CAMERA, truth).copy()
    image[180:, 330:470] = 15  # a dark body over a fifth of the view
    found = fit(road, image, truth @ STARTS[0])
    assert found.converged
    assert_near(found.pose, truth, xy=0.03, yaw=0.004)
    assert found.inliers < 0.95


def shadowed(image):
    """Half of the light is taken from the left of a slanting line."""
    v, u = np.indices(image.shape)
    return np.where(u + 0.4 * v < 0.6 * image.shape[1], image // 2, image).astype(image.dtype)


def test_the_edge_of_a_shadow_moves_little(road):
    truth = road.pose(0.1)
    image = shadowed(road.frame(CAMERA, truth, bits=16))
    even, uneven = (fit(road, image, truth @ STARTS[0], uneven=uneven) for uneven in (False, True))
    assert_near(uneven.pose, truth, xy=0.003, yaw=5e-4)
    assert uneven.residual < 0.5 * even.residual


def test_in_even_light_uneven_light_changes_little(road):
    truth = road.pose(0.1)
    image = road.frame(CAMERA, truth)
    even, uneven = (fit(road, image, truth @ STARTS[0], uneven=uneven) for uneven in (False, True))
    assert_near(uneven.pose, even.pose, xy=0.003, yaw=3e-4)
    assert uneven.fit_score < even.fit_score + 0.1


def test_light_makes_no_match_of_another_place(road):
    image = shadowed(road.frame(CAMERA, road.pose(0.1)))
    found = fit(road, image, road.pose(0.35), uneven=True)
    assert found.fit_score < 0.3


def test_another_place_does_not_look_like_a_match(road):
    found = fit(road, road.frame(CAMERA, road.pose(0.1)), road.pose(0.6))
    assert found.agreement < 0.4
    assert fit(road, road.frame(CAMERA, road.pose(0.1)), road.pose(0.1)).agreement > 0.9
    assert np.isfinite(found.covariance).all()


def test_off_the_map_nothing_converges(road):
    truth = road.pose(0.1)
    blind = replace(road.map, valid=np.zeros(road.map.grey.shape, bool))
    view = RECTIFIER.rectify(road.frame(CAMERA, truth))
    weight = gramian(view.footprint, pixel_noise=0.01, map_noise=0.02)
    refiner = Refiner(RECTIFIER, FIXED, normalized=True, robust=True)
    found = refiner.refine(refiner.layers(view, weight, Crop(blind, 0.05)), truth)
    assert not found.converged
    assert found.overlap == 0.0


def test_cells_whose_map_is_noisy_and_says_so_hardly_count(road):
    truth = road.pose(0.1)
    image = road.frame(CAMERA, truth)
    start = truth @ Pose2(0.02, 0.02, 0.001)
    crop = road.map.crop(start.transform(RECTIFIER.grid.corners()), margin=1.5, cell=0.05)
    # of every two strips of road one was hardly seen when the map was made
    hardly_seen = (np.arange(crop.grey.shape[0]) // 10 % 2 == 0)[:, None]
    noise = np.where(hardly_seen, 0.15, 0.0).astype(np.float32) * np.ones_like(crop.grey)
    refiner = Refiner(RECTIFIER, FIXED, normalized=True, robust=False)
    view = RECTIFIER.rectify(image)
    weight = gramian(view.footprint, pixel_noise=0.01, map_noise=0.02)
    errors = {'known': [], 'unknown': []}
    for seed in range(8):
        grey = crop.grey + noise * np.random.default_rng(seed).standard_normal(
            crop.grey.shape).astype(np.float32)
        for name, known in (('known', noise), ('unknown', None)):
            noisy = Crop(replace(crop, grey=grey, noise=known), 0.05)
            layers = refiner.layers(view, weight, noisy)
            found = refiner.refine(layers, start)
            errors[name].append(math.hypot(*difference(found.pose, truth)[:2]))
    assert np.mean(errors['known']) < 0.7 * np.mean(errors['unknown'])


def test_residuals_lose_their_weight_early_only_where_some_are_no_noise():
    rng = np.random.default_rng(7)
    weights = rng.uniform(1.0, 100.0, 20_000).astype(np.float32)
    noise = (rng.normal(size=weights.size) / np.sqrt(weights)).astype(np.float32)
    assert outlier_scale(noise, weights, 1.0) > 5.8
    struck = noise.copy()
    struck[::20] += np.float32(8.0) / np.sqrt(weights[::20])
    assert outlier_scale(struck, weights, 1.0) == 3.0
    assert outlier_scale(0.3 * noise, weights, 1.0) == 3.0
    assert outlier_scale(noise, np.zeros_like(weights), 1.0) == 3.0


def test_the_calibrated_yaw_of_the_camera_is_an_error_that_no_frame_shows(road):
    truth = road.pose(0.2)
    sigma = 0.01
    exact, doubtful = (
        fit(road, road.frame(CAMERA, truth), truth, refiner=Refiner(
            RECTIFIER, FIXED, normalized=True, robust=True,
            constant_errors=mount_covariance(RECTIFIER.camera.extrinsics.position(), s),
        )) for s in (0.0, sigma)
    )
    x, y, _ = CAMERA.extrinsics.position()
    turned = sigma * np.array([y, -x, 1.0])  # the base about the camera
    assert doubtful.pose == exact.pose
    assert doubtful.covariance - exact.covariance == pytest.approx(np.outer(turned, turned))
