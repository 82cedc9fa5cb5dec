# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Protection level: bound of the error of a published pose at a given risk.

Errors of matches have heavier tails than a normal distribution. Therefore the error of each axis,
divided by its standard deviation, is bounded by a Student t distribution (`protection_terms`,
written by `make fit-protection`), as GNSS receivers bound their errors by a wider normal
distribution (overbounding, DeCleene 2000). The errors that are stated (calibrated yaw
of the camera, accuracy of the map) are bounded by a normal distribution. The level bounds the
error of a match at the right place; `integrity.min_confidence` limits how often the place is
wrong.

"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy.special import ndtri, stdtrit

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.protection_terms import TAILS
from gip_localizer.parameters import Integrity

PROTECTION = ('protection_ahead_m', 'protection_left_m', 'protection_yaw_rad')
"""Names of the level's components among the figures of an estimate."""


def protection_level(covariance: Floats, pose: Pose2, constant: Floats, risk: float) -> Floats:
    """
    Return the protection level (3,): ahead (m), left (m), heading (rad).

    Parameters
    ----------
    covariance : (3, 3) float64
        Covariance of the published x, y (m) and yaw (rad), map axes.
    pose : Pose2
        The published pose.
    constant : (3, 3) float64
        Part of the covariance from the calibrated yaw of the camera and from the map, vehicle
        axes.
    risk : float
        Probability with which any of the three errors may exceed its level.

    """
    turn = np.eye(3)
    turn[:2, :2] = pose.rotation().T
    variance = np.diag(turn @ covariance @ turn.T)
    stated = np.minimum(np.diag(constant), variance)
    factors, normal = _factors(risk)
    return np.asarray(factors * np.sqrt(variance - stated) + normal * np.sqrt(stated))


def protection_figures(
    covariance: Floats, pose: Pose2, constant: Floats, limits: Integrity
) -> dict[str, float]:
    """
    Return the protection level by name, and whether it meets the alert limits (1 or 0).

    Parameters
    ----------
    covariance, pose, constant
        As for `protection_level`.
    limits : Integrity
        Risk, and the alert limits; a limit of 0 is always met.

    """
    levels = protection_level(covariance, pose, constant, limits.risk)
    alerts = (limits.alert_ahead, limits.alert_left, limits.alert_yaw)
    valid = all(
        level <= alert or alert == 0.0 for level, alert in zip(levels, alerts, strict=True)
    )
    return {
        **{name: float(level) for name, level in zip(PROTECTION, levels, strict=True)},
        'protection_valid': float(valid),
    }


@lru_cache(maxsize=8)
def _factors(risk: float) -> tuple[Floats, float]:
    """Return the factors on sigma at a risk: per axis (3,), and of a normal distribution."""
    tail = risk / 6.0  # three axes, two sides each
    factors = [-scale * float(stdtrit(freedom, tail)) for freedom, scale in TAILS]
    return np.array(factors), -float(ndtri(tail))
