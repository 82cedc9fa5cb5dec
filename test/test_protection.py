# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The protection level: its size, its tails, and what it is worth on frames."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm, t
from test_localizer import CAMERA, CERTAIN, make, S

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.protection import PROTECTION, protection_level
from gip_localizer.core.protection_terms import TAILS
from gip_localizer.evaluation.protection_fit import bounding_tail
from gip_localizer.evaluation.suites.protection import (
    misleading,
    misleading_bounds,
    notes,
    stanford_diagram,
)
from gip_localizer.evaluation.suites.trials import Trial

HERE = Pose2(0.0, 0.0, 0.0)
NONE = np.zeros((3, 3))
SIGMAS = np.array([0.02, 0.01, 0.001])


def test_it_grows_as_the_risk_falls_and_is_wider_than_a_normal_distribution():
    levels = [protection_level(np.diag(SIGMAS**2), HERE, NONE, risk) for risk in (1e-3, 1e-5)]
    assert np.all(levels[1] > levels[0])
    for level, risk in zip(levels, (1e-3, 1e-5), strict=True):
        assert np.all(level > norm.isf(risk / 6.0) * SIGMAS)


def test_it_is_that_of_the_fitted_tails():
    level = protection_level(np.diag(SIGMAS**2), HERE, NONE, 1e-4)
    wanted = [scale * t.isf(1e-4 / 6.0, freedom) for freedom, scale in TAILS]
    assert level == pytest.approx(np.array(wanted) * SIGMAS)


def test_it_is_given_in_the_axes_of_the_vehicle():
    to_the_left = Pose2(3.0, 4.0, 0.5 * math.pi)
    level = protection_level(np.diag(SIGMAS**2), HERE, NONE, 1e-3)
    turned = protection_level(np.diag(SIGMAS[[1, 0, 2]]**2), to_the_left, NONE, 1e-3)
    assert turned == pytest.approx(level)


def test_the_calibrated_yaw_is_bounded_by_a_normal_distribution():
    mount = np.diag([0.0, 0.0, 0.0035**2])
    level = protection_level(np.diag(SIGMAS**2) + mount, HERE, mount, 1e-5)
    exact = protection_level(np.diag(SIGMAS**2), HERE, NONE, 1e-5)
    assert level - exact == pytest.approx([0.0, 0.0, norm.isf(1e-5 / 6.0) * 0.0035])


def test_a_fitted_tail_bounds_errors_that_it_was_not_fitted_to():
    rng = np.random.default_rng(11)
    freedom, scale = bounding_tail(1.3 * rng.standard_t(5.0, 600))
    others = np.abs(1.3 * rng.standard_t(5.0, 200_000))
    for risk in (1e-2, 1e-3):
        assert np.mean(others > scale * t.isf(0.5 * risk, freedom)) <= 1.05 * risk


def trial(error, sigma=1e-3):
    return Trial('TRACKING', np.array([error, 0.0, 0.0]), np.array([error, 0.0, 0.0]),
                 np.diag([sigma**2, sigma**2, sigma**2]))


def test_poses_beyond_their_level_are_counted_as_misleading():
    trials = [trial(1e-3)] * 98 + [trial(0.5), trial(-0.5)]
    assert misleading(trials, 1e-5).sum() == 2
    assert [bound.met for bound in misleading_bounds('all', trials)] == [False, False, False]
    assert all(bound.met for bound in misleading_bounds('all', trials[:98]))
    assert '2 of 100 poses misleading' in notes(trials)[0]
    assert len(stanford_diagram(trials, 1e-5).axes) == 3


def test_every_pose_has_a_level_that_its_error_does_not_reach(road):
    localizer = make(road)
    localizer.set_prior(S, road.pose(0.1), CERTAIN)
    truth = road.pose(0.1)
    estimate = localizer.update(S, road.frame(CAMERA, truth), CAMERA)
    levels = [estimate.quality[name] for name in PROTECTION]
    assert estimate.published
    assert np.all(np.abs(difference(truth.inverse() @ estimate.pose, HERE)) < levels)
    assert estimate.quality['protection_valid'] == 1.0


@pytest.mark.parametrize('limit', ['alert_ahead', 'alert_left', 'alert_yaw'])
def test_a_level_above_an_alert_limit_is_reported_as_invalid(road, limit):
    localizer = make(road, **{f'integrity__{limit}': 1e-6})
    localizer.set_prior(S, road.pose(0.1), CERTAIN)
    estimate = localizer.update(S, road.frame(CAMERA, road.pose(0.1)), CAMERA)
    assert estimate.published
    assert estimate.quality['protection_valid'] == 0.0


def test_a_withheld_frame_has_no_level(road):
    estimate = make(road).update(S, road.frame(CAMERA, road.pose(0.1)), CAMERA)
    assert not estimate.published
    assert 'protection_valid' not in estimate.quality
