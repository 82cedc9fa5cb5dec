# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import math

import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
from match_samples import (
    ANCHOR,
    candidate_score,
    GRID,
    loop_scores,
    texture,
    texture_map,
    turned,
    view_from,
    weights,
)
import numpy as np
import pytest

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.score_surface import Lattice, make_lattice, match, rotated
from gip_localizer.core.pose import Pose2

RELATIVE = 1e-5
WINDOW = make_lattice(ANCHOR, x=0.6, y=0.5, yaw=0.0, yaw_step=0.02, step=0.1)
TRUTH = ANCHOR @ Pose2(0.2, -0.3, 0.0)
METRICS = [(equal, normalized) for equal in (False, True) for normalized in (False, True)]


@pytest.mark.parametrize(('equal', 'normalized'), METRICS)
@pytest.mark.parametrize('hole', [False, True])
def test_scores_equal_a_plain_float64_loop(equal, normalized, hole):
    raster_map, weight = texture_map(hole=hole), weights(equal=equal)
    view = view_from(texture_map(), TRUTH, weight)
    scores = match(view, weight, raster_map, WINDOW, normalized=normalized, min_overlap=0.66)
    residual, overlap = loop_scores(
        view, weight, raster_map, WINDOW, normalized=normalized, min_overlap=0.66
    )
    seen = np.isfinite(residual)
    np.testing.assert_array_equal(np.isfinite(scores.residual), seen)
    np.testing.assert_allclose(scores.residual[seen], residual[seen], rtol=RELATIVE)
    np.testing.assert_allclose(scores.overlap, overlap, atol=1e-5)
    assert scores.best() == np.unravel_index(residual.argmin(), residual.shape)
    if hole:
        assert 0 < seen.sum() < seen.size  # the overlap rule had something to do
        assert (overlap[seen] < 0.999).any()
    else:
        assert seen.all()
        assert scores.best() == (0, 4, 8)  # 0.2 m ahead: 2 steps of 6 up; 0.3 m right: 3 of 5


@pytest.mark.parametrize('normalized', [False, True])
def test_scores_at_other_yaws_equal_the_loop_over_turned_sums(normalized):
    raster_map, weight = texture_map(hole=True), weights(equal=False)
    view = view_from(texture_map(), ANCHOR @ Pose2(0.1, 0.0, 0.06), weight)
    lattice = make_lattice(ANCHOR, x=0.2, y=0.2, yaw=0.06, yaw_step=0.03, step=0.1)
    scores = match(view, weight, raster_map, lattice, normalized=normalized, min_overlap=0.05)
    canvas = Grid(7.0, 3.0, 64, 60, 0.1)  # any that holds the view at every yaw
    for k, i, j in np.ndindex(lattice.shape):
        yaw = float(lattice.yaws[k])
        G, Gv, Gvv = (
            turned(plane, GRID, canvas, yaw)
            for plane in (weight, weight * view.patch, weight * view.patch**2)
        )
        shift = lattice.anchor @ Pose2(*lattice.offset(np.array([k, i, j]))[:2], 0.0)
        u, known = raster_map.sample(shift.transform(canvas.points()))
        K, u = known.reshape(canvas.shape), u.reshape(canvas.shape).astype(float)
        expected = _from_sums(G * K, Gv * K, Gvv * K, u, normalized=normalized)
        # OpenCV turns with 1/32 of a cell
        assert scores.residual[k, i, j] == pytest.approx(expected, rel=0.01)
    assert scores.best() == (4, 1, 2)


def _from_sums(G, Gv, Gvv, u, *, normalized: bool) -> float:
    w = G.sum()
    if not normalized:
        return float((Gvv.sum() - 2.0 * (Gv * u).sum() + (G * u * u).sum()) / w)
    mean_v, mean_u = Gv.sum() / w, (G * u).sum() / w
    cov = (Gv * u).sum() / w - mean_v * mean_u
    var_u = (G * u * u).sum() / w - mean_u**2
    var_v = Gvv.sum() / w - mean_v**2
    return float(var_v - max(cov, 0.0) ** 2 / var_u)


def test_scores_equal_opencv_s_masked_template_matching():
    # OpenCV squares the mask, so that the weight is √G; its windows start where ours do.
    grey, weight = texture((80, 100)), weights(equal=False)
    raster_map = RasterMap(grey, 0.1, Pose2(-1.0, -3.0, 0.0))
    view = view_from(raster_map, Pose2(0.2, -0.1, 0.0), weight)
    lattice = make_lattice(Pose2(0.0, 0.0, 0.0), x=0.8, y=0.7, yaw=0.0, yaw_step=1.0, step=0.1)
    scores = match(view, weight, raster_map, lattice, normalized=False, min_overlap=0.5)
    row, col = raster_map.to_cell(np.array([[GRID.far - 0.05 + 0.8, GRID.left - 0.05 + 0.7]]))[0]
    # the grid's rows run against x and its columns against y: the map, turned a quarter
    image = np.rot90(grey, 1)
    top, left = round(image.shape[0] - 1 - col), round(row)
    window = np.ascontiguousarray(image[top : top + 40 + 16, left : left + 30 + 14])
    expected = cv2.matchTemplate(window, view.patch, cv2.TM_SQDIFF, mask=np.sqrt(weight))
    total = weight.sum(dtype=float)
    np.testing.assert_allclose(scores.residual[0] * total, expected, rtol=2e-4)
    assert scores.best()[1:] == np.unravel_index(expected.argmin(), expected.shape) == (6, 8)


def test_equal_weights_give_the_plain_norm():
    raster_map, weight = texture_map(), np.ones(GRID.shape, np.float32)
    view = view_from(raster_map, TRUTH, weight)
    scores = match(view, weight, raster_map, WINDOW, normalized=False, min_overlap=0.5)
    u, _ = raster_map.sample(WINDOW.pose(np.array([0, 2, 3])).transform(GRID.points()))
    norm_sq = np.linalg.norm(view.patch.ravel().astype(float) - u) ** 2
    assert scores.residual[0, 2, 3] * GRID.rows * GRID.cols == pytest.approx(norm_sq, rel=1e-5)


@settings(max_examples=12)
@given(st.floats(-6.0, 6.0), st.booleans(), st.booleans())
def test_scaling_the_gramian_moves_nothing(exponent, normalized, hole):
    raster_map, weight = texture_map(hole=hole), weights(equal=False)
    view = view_from(texture_map(), TRUTH, weight)
    scaled = (weight * 10.0**exponent).astype(np.float32)
    a, b = (match(view, w, raster_map, WINDOW, normalized=normalized, min_overlap=0.6)
            for w in (weight, scaled))
    assert a.best() == b.best()
    seen = np.isfinite(a.residual)
    np.testing.assert_array_equal(seen, np.isfinite(b.residual))
    np.testing.assert_allclose(a.residual[seen], b.residual[seen], rtol=1e-4)


@settings(max_examples=12)
@given(st.floats(0.05, 20.0), st.floats(-3.0, 3.0))
def test_gain_and_offset_do_not_move_a_normalized_winner(gain, offset):
    raster_map, weight = texture_map(), weights(equal=False)
    view = view_from(raster_map, TRUTH, weight, noise=0.02 * gain, gain=gain, offset=offset)
    scores = match(view, weight, raster_map, WINDOW, normalized=True, min_overlap=0.5)
    assert scores.best() == (0, 4, 8)
    assert scores.correlation[scores.best()] > 0.95
    plain = view_from(raster_map, TRUTH, weight, noise=0.02)
    reference = match(plain, weight, raster_map, WINDOW, normalized=True, min_overlap=0.5)
    np.testing.assert_allclose(scores.correlation, reference.correlation, atol=1e-5)


def test_a_negative_picture_does_not_match():
    raster_map, weight = texture_map(), weights(equal=False)
    view = view_from(raster_map, TRUTH, weight, gain=-1.0, offset=1.0, noise=0.01)
    scores = match(view, weight, raster_map, WINDOW, normalized=True, min_overlap=0.5)
    assert scores.best() != (0, 4, 8)
    assert scores.correlation[0, 4, 8] < -0.95


def test_unknown_map_cells_carry_no_weight():
    # What the array holds under the mask must not matter.
    holed = texture_map(hole=True)
    grey = np.array(holed.grey)
    grey[~holed.valid] = 1.0
    weight = weights(equal=False)
    view = view_from(texture_map(), TRUTH, weight)
    a, b = (match(view, weight, m, WINDOW, normalized=False, min_overlap=0.3)
            for m in (holed, replace(holed, grey=grey)))
    np.testing.assert_array_equal(a.residual, b.residual)


def test_cells_outside_the_view_carry_no_weight():
    raster_map, weight = texture_map(), weights(equal=False)
    view = view_from(raster_map, TRUTH, weight)
    patch = view.patch.copy()
    patch[weight == 0.0] = 7.0
    other = View(patch, view.footprint, view.valid, view.grid)
    a, b = (match(v, weight, raster_map, WINDOW, normalized=True, min_overlap=0.5)
            for v in (view, other))
    np.testing.assert_array_equal(a.residual, b.residual)


@pytest.mark.parametrize('normalized', [False, True])
def test_off_the_map_no_candidate_has_a_score_and_nothing_is_nan(normalized):
    weight = weights(equal=False)
    view = view_from(texture_map(), TRUTH, weight)
    far = replace(WINDOW, anchor=Pose2(500.0, 0.0, 0.0))
    scores = match(view, weight, texture_map(), far, normalized=normalized, min_overlap=0.05)
    assert np.isinf(scores.residual).all()
    assert not scores.overlap.any()
    assert not np.isnan(scores.correlation).any()


@pytest.mark.parametrize('flat', ['view', 'map', 'both'])
def test_flat_views_and_maps_give_no_nan_and_no_correlation(flat):
    weight, raster_map = weights(equal=False), texture_map()
    view = view_from(raster_map, TRUTH, weight)
    if flat in ('view', 'both'):
        view = View(np.full(GRID.shape, 0.4, np.float32), weight, weight > 0.0, GRID)
    if flat in ('map', 'both'):
        raster_map = replace(raster_map, grey=np.full((200, 220), 0.7, np.float32))
    scores = match(view, weight, raster_map, WINDOW, normalized=True, min_overlap=0.5)
    assert np.isfinite(scores.residual).all()
    assert np.abs(scores.correlation).max() < 0.01


def test_a_view_without_weight_has_no_candidates():
    weight = np.zeros(GRID.shape, np.float32)
    view = View(np.zeros(GRID.shape, np.float32), weight, weight > 0.0, GRID)
    scores = match(view, weight, texture_map(), WINDOW, normalized=True, min_overlap=0.05)
    assert np.isinf(scores.residual).all()


@settings(max_examples=20)
@given(st.floats(-math.pi, math.pi))
def test_turning_keeps_the_sum_of_the_weights_and_matches_scipy(yaw):
    weight = weights(equal=False)
    canvas = Grid(7.5, 7.5, 150, 150, 0.1)
    planes = rotated(np.dstack([weight, weight, weight]), GRID, canvas, yaw)
    expected = turned(weight, GRID, canvas, yaw)
    assert planes[..., 0].sum() == pytest.approx(weight.sum(), rel=0.01)
    np.testing.assert_allclose(planes[..., 0], expected, atol=0.05 * weight.max())
    assert np.abs(planes[..., 0] - expected).mean() < 0.002 * weight.max()


@given(st.floats(0.0, 3.0), st.floats(0.0, 3.0), st.floats(0.0, 1.0), st.floats(0.01, 0.3),
       st.floats(0.02, 0.5))
def test_a_lattice_is_symmetric_and_covers_its_window(x, y, yaw, yaw_step, step):
    lattice = make_lattice(ANCHOR, x=x, y=y, yaw=yaw, yaw_step=yaw_step, step=step)
    n_yaw, n_x, n_y = lattice.shape
    first = lattice.offset(np.array([0, 0, 0]))
    last = lattice.offset(np.array([n_yaw - 1, n_x - 1, n_y - 1]))
    assert first.x == pytest.approx(-last.x)
    assert first.y == pytest.approx(-last.y)
    assert first.yaw == pytest.approx(-last.yaw)
    assert x - 1e-6 <= first.x < x + step
    assert y - 1e-6 <= first.y < y + step
    assert yaw - 1e-6 <= last.yaw < yaw + yaw_step
    middle = lattice.pose(np.array([n_yaw // 2, n_x // 2, n_y // 2]))
    assert middle == pytest.approx(tuple(ANCHOR), abs=1e-9)


def test_a_window_of_one_candidate_is_scored():
    raster_map, weight = texture_map(), weights(equal=False)
    view = view_from(raster_map, ANCHOR, weight)
    one = Lattice(ANCHOR, 0.1, (0, 0), np.zeros(1))
    scores = match(view, weight, raster_map, one, normalized=False, min_overlap=0.5)
    u, _ = raster_map.sample(ANCHOR.transform(GRID.points()))
    expected = candidate_score(weight, view.patch, u.reshape(GRID.shape), normalized=False)
    assert scores.residual.shape == (1, 1, 1)
    assert scores.residual[0, 0, 0] == pytest.approx(expected, rel=1e-5)
