# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Protection level: how far a published pose may be off at a chosen risk.

Errors of matches have heavier tails than a normal distribution. Their quotients by the standard
deviation are bounded by a Student t distribution per axis (`protection_terms`, written by `make
fit-protection`), as GNSS receivers bound theirs by a wider normal one (overbounding, DeCleene
2000). The calibrated yaw of the camera is bounded by a normal distribution, as it is given. The
level bounds the error of a match at the right place; how rarely a place is wrong is a matter of
`integrity.min_confidence`.

"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.stats import norm, t

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.protection_terms import TAILS

PROTECTION = ('protection_ahead_m', 'protection_left_m', 'protection_yaw_rad')
"""Names of the level's components among the figures of an estimate."""


def protection_level(covariance: Floats, pose: Pose2, mount: Floats, risk: float) -> Floats:
    """
    Return the protection level (3,): ahead (m), left (m), heading (rad).

    Parameters
    ----------
    covariance : (3, 3) float64
        Of the published x, y (m) and yaw (rad), map axes.
    pose : Pose2
        The published pose.
    mount : (3, 3) float64
        Part of it from the calibrated yaw of the camera, vehicle axes.
    risk : float
        Probability with which any of the three errors may exceed its level.

    """
    turn = np.eye(3)
    turn[:2, :2] = pose.rotation().T
    variance = np.diag(turn @ covariance @ turn.T)
    of_mount = np.minimum(np.diag(mount), variance)
    factors, normal = _factors(risk)
    return np.asarray(factors * np.sqrt(variance - of_mount) + normal * np.sqrt(of_mount))


@lru_cache(maxsize=8)
def _factors(risk: float) -> tuple[Floats, float]:
    """Standard deviations per axis (3,) at a risk, and those of a normal distribution."""
    tail = risk / 6.0  # three axes, two sides each
    factors = [scale * float(t.isf(tail, freedom)) for freedom, scale in TAILS]
    return np.array(factors), float(norm.isf(tail))
