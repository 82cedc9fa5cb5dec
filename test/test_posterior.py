# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from match_samples import ANCHOR, GRID
import numpy as np
import pytest

from gip_localizer.core.belief import Belief
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.estimate import Match
from gip_localizer.core.match.posterior import (
    independent_cells,
    modes,
    posterior_surface,
    subcell_peak,
)
from gip_localizer.core.match.score_surface import make_lattice, Scores
from gip_localizer.core.pose import Pose2

STEP, YAW_STEP = 0.1, 0.02
LATTICE = make_lattice(ANCHOR, x=1.0, y=0.8, yaw=0.1, yaw_step=YAW_STEP, step=STEP)


def bowls(*centres: tuple[float, float, float, float], width: float = 0.3) -> Scores:
    """A surface with minima at (x, y, yaw) of a depth, the best of them 0.01."""
    n_yaw, n_x, n_y = LATTICE.shape
    x = ((LATTICE.half[0] - np.arange(n_x)) * STEP)[None, :, None]
    y = ((LATTICE.half[1] - np.arange(n_y)) * STEP)[None, None, :]
    yaw = LATTICE.yaws.reshape(n_yaw, 1, 1)
    bowl = [
        depth + ((x - cx) ** 2 + (y - cy) ** 2) / width**2 + (yaw - cyaw) ** 2 / 0.05**2
        for cx, cy, cyaw, depth in centres
    ]
    residual = (0.01 * np.minimum(np.minimum.reduce(bowl), 3.0)).astype(np.float32)
    ones = np.ones(LATTICE.shape, np.float32)
    return Scores(LATTICE, residual, ones, ones)


@settings(max_examples=40)
@given(st.floats(-0.7, 0.7), st.floats(-0.6, 0.6), st.floats(-0.07, 0.07))
def test_the_peak_between_candidates_is_found(x, y, yaw):
    surface = posterior_surface(bowls((x, y, yaw, 1.0)), 200.0, None)
    index = modes(surface, 1)[0]
    assert index == surface.winner
    offset = LATTICE.offset(subcell_peak(surface, index))
    assert offset == pytest.approx((x, y, yaw), abs=0.1 * STEP)
    assert surface.winner_mass > 0.99


def test_two_places_alike_share_the_mass_and_both_are_modes():
    surface = posterior_surface(bowls((0.5, 0.5, 0.0, 1.0), (-0.5, -0.5, 0.0, 1.0)), 200.0, None)
    assert surface.winner_mass == pytest.approx(0.5, abs=0.01)
    assert surface.second_ratio == pytest.approx(1.0, abs=1e-4)
    found = {tuple(np.round(LATTICE.offset(np.array(i))[:2], 3)) for i in modes(surface, 2)}
    assert found == {(0.5, 0.5), (-0.5, -0.5)}
    assert surface.covariance[0, 0] == pytest.approx(0.25, rel=0.05)
    assert surface.covariance[0, 1] == pytest.approx(0.25, rel=0.05)


def test_a_worse_place_is_told_by_its_ratio():
    surface = posterior_surface(bowls((0.5, 0.5, 0.0, 1.0), (-0.5, -0.5, 0.0, 1.2)), 200.0, None)
    assert surface.second_ratio == pytest.approx(1.2, abs=0.01)
    assert surface.winner_mass > 0.99


def test_the_prior_decides_between_places_alike():
    scores = bowls((0.5, 0.5, 0.0, 1.0), (-0.5, -0.5, 0.0, 1.0))
    centre = ANCHOR @ Pose2(-0.4, -0.4, 0.0)
    prior = Belief(0, centre, np.diag([0.2**2, 0.2**2, 0.1**2]))
    surface = posterior_surface(scores, 200.0, prior)
    offset = LATTICE.offset(np.array(surface.winner))
    assert offset == pytest.approx((-0.5, -0.5, 0.0), abs=1e-6)
    assert surface.winner_mass > 0.99


def test_a_prior_in_map_axes_is_turned_to_the_anchor_s():
    # Flat scores: the posterior is the prior itself.
    ones = np.ones(LATTICE.shape, np.float32)
    scores = Scores(LATTICE, 0.01 * ones, ones, ones)
    turn = np.eye(3)
    turn[:2, :2] = ANCHOR.rotation()
    own = np.diag([0.2**2, 0.1**2, 0.03**2])
    prior = Belief(0, ANCHOR, turn @ own @ turn.T)
    surface = posterior_surface(scores, 100.0, prior)
    np.testing.assert_allclose(surface.covariance, own, rtol=0.05, atol=1e-5)


@pytest.mark.parametrize('cells', [50.0, 100.0, 200.0])
def test_the_spread_is_the_inverse_curvature(cells):
    # log p = -n/2 · d²/width²: variance width²/n
    surface = posterior_surface(bowls((0.0, 0.0, 0.0, 1.0), width=1.0), cells, None)
    expected = 1.0 / cells
    assert surface.covariance[0, 0] == pytest.approx(expected, rel=0.1)
    assert surface.covariance[2, 2] == pytest.approx(max(0.05**2 / cells, 0.0), rel=0.2, abs=4e-5)


def test_candidates_without_overlap_have_no_probability():
    scores = bowls((0.0, 0.0, 0.0, 1.0))
    scores.residual[:, :, : LATTICE.shape[2] // 2 + 1] = np.inf
    surface = posterior_surface(scores, 200.0, None)
    assert np.isneginf(surface.log_posterior[:, :, 0]).all()
    assert surface.winner[2] > LATTICE.shape[2] // 2
    assert np.isfinite(surface.covariance).all()
    assert math.isfinite(surface.entropy)
    peak = subcell_peak(surface, surface.winner)
    assert np.isfinite(peak).all()


def test_a_single_candidate_is_certain():
    lattice = make_lattice(ANCHOR, x=0.0, y=0.0, yaw=0.0, yaw_step=0.1, step=0.1)
    one = np.full((1, 1, 1), 0.02, np.float32)
    surface = posterior_surface(Scores(lattice, one, one, one), 100.0, None)
    assert surface.winner == (0, 0, 0)
    assert surface.winner_mass == 1.0
    assert surface.second_ratio == math.inf
    assert surface.entropy == pytest.approx(0.0, abs=1e-9)
    assert modes(surface, 5) == [(0, 0, 0)]
    np.testing.assert_array_equal(subcell_peak(surface, (0, 0, 0)), [0.0, 0.0, 0.0])


def test_a_perfect_match_is_no_division_by_zero():
    ones = np.ones(LATTICE.shape, np.float32)
    residual = 0.01 * ones
    residual[5, 10, 8] = 0.0
    surface = posterior_surface(Scores(LATTICE, residual, ones, ones), 100.0, None)
    assert surface.winner == (5, 10, 8)
    assert surface.winner_mass == pytest.approx(1.0)
    assert np.isfinite(surface.covariance).all()


@given(st.floats(0.001, 1000.0))
def test_independent_cells_do_not_depend_on_the_scale_of_the_weights(scale):
    weight = np.random.default_rng(1).random((20, 30))
    assert independent_cells(scale * weight) == pytest.approx(independent_cells(weight))
    assert independent_cells(np.ones((20, 30))) > independent_cells(weight)
    assert independent_cells(np.zeros((3, 3))) == 1.0


def test_contrast_is_the_weighted_deviation():
    patch = np.random.default_rng(2).random(GRID.shape).astype(np.float32)
    weight = np.zeros(GRID.shape, np.float32)
    weight[:10] = 2.0
    view = View(patch, weight, weight > 0.0, GRID)
    assert Match(view, weight).contrast == pytest.approx(patch[:10].std(), rel=1e-5)
    assert Match(view, np.zeros_like(weight)).contrast == 0.0
