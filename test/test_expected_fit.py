# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Which fit of a tracked frame ends its search, and what it changes."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from test_localizer import CAMERA, CERTAIN, make, S

from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2
from gip_localizer.core.search.expected_fit import ExpectedFit, FitReference

PREDICTED = Pose2(3.0, 2.0, 0.1)
SPREAD = np.diag([0.05, 0.05, 0.01]) ** 2
REFERENCE = FitReference(fit_score=1.5, overdispersion=3.0)


def fit(pose=PREDICTED, *, score=1.5, dispersion=3.0, converged=True):
    return SimpleNamespace(
        pose=pose, fit_score=score, overdispersion=dispersion, converged=converged
    )


def test_a_fit_near_the_prediction_that_is_as_good_is_expected():
    expected = ExpectedFit(Belief(S, PREDICTED, SPREAD), REFERENCE)
    assert expected.is_met_by(fit())
    assert expected.is_met_by(fit(Pose2(3.1, 1.9, 0.11), score=1.4, dispersion=4.0))


@pytest.mark.parametrize('other', [
    fit(Pose2(3.16, 2.0, 0.1)), fit(Pose2(3.0, 1.84, 0.1)), fit(Pose2(3.0, 2.0, 0.12)),
    fit(score=1.34), fit(dispersion=4.6), fit(converged=False),
])  # fmt: skip
def test_a_fit_that_is_aside_or_worse_is_not(other):
    assert not ExpectedFit(Belief(S, PREDICTED, SPREAD), REFERENCE).is_met_by(other)


@pytest.mark.parametrize('sigmas', [(0.16, 0.05, 0.01), (0.05, 0.16, 0.01), (0.05, 0.05, 0.04)])
def test_a_vague_prediction_expects_nothing(sigmas):
    vague = Belief(S, PREDICTED, np.diag(np.square(sigmas)))
    assert not ExpectedFit(vague, REFERENCE).is_met_by(fit())


def test_a_tracked_frame_takes_the_expected_fit_and_gives_the_same_pose(road):
    truth = road.pose(0.3)
    localizer, cautious = make(road), make(road)
    for one in (localizer, cautious):
        one.set_prior(S, truth, CERTAIN)
    for number in range(1, 6):
        image = road.frame(CAMERA, truth, seed=number)
        cautious.state.reference = None
        poses = [one.update(S + number * S // 10, image, CAMERA) for one in (localizer, cautious)]
    assert localizer.state.reference is not None
    assert all(pose.published for pose in poses)
    assert poses[0].pose.distance(poses[1].pose) < 1e-4
    localizer.set_prior(2 * S, truth, CERTAIN)
    assert localizer.state.reference is None  # a new start is compared with other modes first
