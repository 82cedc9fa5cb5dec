# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.birdseye.pixel_noise import estimate_pixel_noise
from gip_localizer.core.gramian import gramian, NOISE_FLOOR

AREAS = np.array([[0.0, 0.5, 2.0], [10.0, 300.0, 5000.0]], np.float32)


def test_without_map_noise_the_weight_is_the_paper_s():
    weight = gramian(AREAS, pixel_noise=0.02, map_noise=0.0)
    np.testing.assert_allclose(weight, AREAS / 0.02**2, rtol=1e-6)


def test_with_map_noise_the_weight_is_one_over_the_whole_variance():
    weight = gramian(AREAS, pixel_noise=0.02, map_noise=0.03)
    assert weight[0, 0] == 0.0
    seen = AREAS > 0
    np.testing.assert_allclose(
        weight[seen], 1.0 / (0.02**2 / AREAS[seen] + 0.03**2), rtol=1e-5
    )
    assert weight.max() < 1.0 / 0.03**2


def test_no_noise_at_all_still_gives_finite_weights():
    weight = gramian(AREAS, pixel_noise=0.0, map_noise=0.0)
    assert np.isfinite(weight).all()
    np.testing.assert_allclose(weight, AREAS / NOISE_FLOOR**2, rtol=1e-5)


@pytest.mark.parametrize('sigma', [0.01, 0.03, 0.1])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16, np.float32])
def test_the_noise_of_an_image_is_found_under_gradients_and_edges(sigma, dtype):
    rng = np.random.default_rng(5)
    scene = np.linspace(0.35, 0.55, 640)[None, :] * np.ones((480, 1))
    scene[:, 300:] += 0.1
    image = scene + sigma * rng.standard_normal(scene.shape)
    if dtype is not np.float32:
        image = np.clip(np.round(image * np.iinfo(dtype).max), 0, np.iinfo(dtype).max)
    assert estimate_pixel_noise(image.astype(dtype)) == pytest.approx(sigma, rel=0.1)


@pytest.mark.parametrize('shape', [(1, 1), (3, 800), (5, 5), (480, 640)])
def test_a_flat_image_has_the_noise_floor(shape):
    assert estimate_pixel_noise(np.full(shape, 77, np.uint8)) == NOISE_FLOOR
