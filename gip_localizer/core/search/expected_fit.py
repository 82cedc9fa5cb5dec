# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The fit that the track lets expect; if it is found, no other mode of the window is refined."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import difference
from gip_localizer.core.refine.fit import Fit

# Largest own standard deviations of the prediction (m, rad; design choice: 0.15 m and 0.03 rad, as
# for a prior that supports a match, `integrity`).
TIGHT_XY, TIGHT_YAW = 0.15, 0.03
# Largest distance (m, m, rad) of the fit from the prediction (design choice: half of the 0.3 m
# between two modes, and the half step in heading of a lattice).
NEAREST = np.array([0.15, 0.15, 0.0175])
# Least fit score and largest overdispersion, as shares of those of the reference (no unit; design
# choice: 0.9 and 1.5; with 0.8 the error under hard shadows grew by a quarter, and a fit 0.26 m
# off had 0.7 of the fit score).
LEAST_SCORE, MOST_DISPERSION = 0.9, 1.5


class FitReference(NamedTuple):
    """
    Figures of the last fix that was compared with the other modes of its window.

    Attributes
    ----------
    fit_score, overdispersion : float
        As of its `Fit`.

    """

    fit_score: float
    overdispersion: float


@dataclass(frozen=True, eq=False)
class ExpectedFit:
    """
    Prediction of a fit.

    Attributes
    ----------
    prior : Belief
        Prediction of the pose, which published fixes confirm.
    reference : FitReference
        How well the last fix fitted.

    """

    prior: Belief
    reference: FitReference

    def is_met_by(self, fit: Fit) -> bool:
        """Return whether a fit lies near a tight prediction and fits as well as the reference."""
        sigma = np.sqrt(np.maximum(np.diag(self.prior.own_covariance), 0.0))
        if sigma[:2].max() > TIGHT_XY or sigma[2] > TIGHT_YAW or not fit.converged:
            return False
        gap = np.abs(difference(fit.pose, self.prior.pose))
        return bool(
            np.all(gap < NEAREST)
            and fit.fit_score > LEAST_SCORE * self.reference.fit_score
            and fit.overdispersion < MOST_DISPERSION * self.reference.overdispersion
        )
