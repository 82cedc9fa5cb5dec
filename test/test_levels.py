# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from match_samples import ANCHOR, GRID, texture, texture_map, view_from, weights
import numpy as np
import pytest

from gip_localizer.core.match.downsampling import downsampled_view, locally_centred
from gip_localizer.core.pose import Pose2

TRUTH = ANCHOR @ Pose2(0.2, -0.3, 0.0)


@pytest.mark.parametrize('factor', [1, 2, 3, 7])
def test_joining_cells_keeps_weights_and_weighted_sums(factor):
    weight = weights(equal=False)
    view = view_from(texture_map(), TRUTH, weight)
    joined, total = downsampled_view(view, weight, factor)
    assert joined.grid.shape == (math.ceil(40 / factor), math.ceil(30 / factor))
    assert total.sum() == pytest.approx(weight.sum(), rel=1e-5)
    assert (total * joined.patch).sum() == pytest.approx((weight * view.patch).sum(), rel=1e-5)
    assert (joined.grid.far, joined.grid.left) == (GRID.far, GRID.left)
    assert joined.grid.resolution == pytest.approx(0.1 * factor)
    np.testing.assert_array_equal(joined.valid, total > 0.0)


def test_slow_changes_of_brightness_are_taken_out_and_texture_stays():
    grey = texture((120, 120), blur=0.8)
    known = np.ones(grey.shape, np.float32)
    shade = np.linspace(0.0, 0.5, 120, dtype=np.float32)[None, :]
    plain, shaded = (locally_centred(g, known, 0.1) for g in (grey, grey + shade))
    inner = (slice(10, -10), slice(10, -10))
    np.testing.assert_allclose(shaded[inner], plain[inner], atol=1e-4)
    assert np.corrcoef(plain[inner].ravel(), grey[inner].ravel())[0, 1] > 0.9
    assert abs(float(plain[inner].mean())) < 0.01


def test_what_is_unknown_does_not_leak_and_what_sticks_out_is_clipped():
    grey = texture((60, 60), blur=0.8)
    known = np.ones(grey.shape, np.float32)
    known[:20] = 0.0
    other = grey.copy()
    other[:20] = 100.0
    a, b = locally_centred(grey, known, 0.1), locally_centred(other, known, 0.1)
    np.testing.assert_allclose(a, b, atol=1e-4)
    assert not a[:20].any()
    spiked = grey.copy()
    spiked[40, 40] = 50.0
    assert np.abs(locally_centred(spiked, known, 0.1)).max() < 2.0


def test_nothing_known_gives_zeros():
    empty = np.zeros((10, 10), np.float32)
    assert not locally_centred(texture((10, 10)), empty, 0.1).any()
