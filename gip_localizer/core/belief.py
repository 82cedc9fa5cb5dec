# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A Gaussian belief on SE(2), and the check of a prior from outside."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.errors import GipError

SHARPEST, SHARPEST_RATIO = 1e-12, 1e-9  # least variance, m² and rad², and least of two axes
VAGUEST = 1e12  # m², rad²: beyond this a prior is none


class PriorError(GipError):
    """A prior pose or its covariance cannot be used."""


@dataclass(frozen=True, eq=False)
class Belief:
    """
    Pose and covariance at a stamp.

    Attributes
    ----------
    stamp_ns : int
        Nanoseconds.
    pose : Pose2
        Base in map.
    covariance : (3, 3) float64
        Of x, y (m), yaw (rad), map axes.
    driven, since_fix : float
        Metres and seconds since the last fix.
    shared : (3, 3) float64
        Covariance of the error with the standardized smooth error of the matches, which does not
        average over time: `shared @ shared.T` is the part of the covariance it explains.

    """

    stamp_ns: int
    pose: Pose2
    covariance: Floats
    driven: float = 0.0
    since_fix: float = 0.0
    shared: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def own_covariance(self) -> Floats:
        """Covariance (3, 3) without the part that the next match shares."""
        return self.covariance - self.shared @ self.shared.T


def checked_prior(stamp_ns: int, pose: Pose2, covariance: Floats) -> Belief:
    """
    Return a belief for a prior from outside.

    Raises
    ------
    PriorError
        NaN, or a covariance that is not symmetric positive definite or beyond all bounds.

    """
    covariance = np.asarray(covariance, float)
    if covariance.shape != (3, 3):
        raise PriorError(
            f'prior covariance has shape {covariance.shape}; expected (3, 3): x, y, yaw'
        )
    if not pose.is_finite() or not np.isfinite(covariance).all():
        raise PriorError('prior holds NaN or infinity; expected finite x, y, yaw and covariance')
    if np.abs(covariance).max() > VAGUEST:
        raise PriorError(
            f'prior covariance is too large to be of use ({np.abs(covariance).max():.3g}); '
            'call ~/relocalize instead'
        )
    symmetric = 0.5 * (covariance + covariance.T)
    if np.any(np.diag(symmetric) <= 0.0) or np.linalg.eigvalsh(symmetric)[0] <= 0.0:
        raise PriorError(
            'prior covariance is not positive definite (variances '
            f'{", ".join(f"{value:g}" for value in np.diag(symmetric))}); '
            'expected variances of x, y and yaw above zero'
        )
    sharpest = max(SHARPEST, SHARPEST_RATIO * float(np.diag(symmetric)[:2].max()))
    floor = np.diag([sharpest, sharpest, SHARPEST])
    return Belief(stamp_ns, Pose2(pose.x, pose.y, wrap_angle(pose.yaw)), symmetric + floor)
