# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Gaussian belief on SE(2), and the check of a prior that a user or a node gives."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.errors import GipError

# Least variance of a prior (m², rad²), which is added to its covariance (design choice: 1e-12, far
# below any real error, because the covariance must be invertible in double precision).
MIN_VARIANCE = 1e-12
# Least ratio of a prior's variances in x and y to the larger one (no unit; design choice: 1e-9,
# because the condition of the covariance must stay far below 1e16).
MIN_VARIANCE_RATIO = 1e-9
# Largest element of a prior's covariance (m², rad²; design choice: 1e12, because such a prior
# constrains nothing on any map).
MAX_VARIANCE = 1e12


class PriorError(GipError):
    """A prior pose or its covariance cannot be used."""


@dataclass(frozen=True, eq=False)
class Belief:
    """
    Pose and covariance at a stamp.

    Attributes
    ----------
    stamp_ns : int
        Stamp, nanoseconds.
    pose : Pose2
        Pose of base in map.
    covariance : (3, 3) float64
        Covariance of x, y (m) and yaw (rad), map axes.
    driven, since_fix : float
        Distance (m) and time (s) since the last fix.
    shared : (3, 3) float64
        Covariance of the error with the standardized smooth error of the matches, which does not
        average out over time: `shared @ shared.T` is the part of the covariance that it causes.

    """

    stamp_ns: int
    pose: Pose2
    covariance: Floats
    driven: float = 0.0
    since_fix: float = 0.0
    shared: Floats = field(default_factory=lambda: np.zeros((3, 3)))

    @property
    def own_covariance(self) -> Floats:
        """Covariance (3, 3) without the part of errors that the next match shares."""
        return self.covariance - self.shared @ self.shared.T


def checked_prior(stamp_ns: int, pose: Pose2, covariance: Floats) -> Belief:
    """
    Return a prior as a belief.

    Raises
    ------
    PriorError
        NaN, or a covariance that is not positive definite or exceeds `MAX_VARIANCE`.

    """
    covariance = np.asarray(covariance, float)
    if covariance.shape != (3, 3):
        raise PriorError(
            f'prior covariance has shape {covariance.shape}; expected (3, 3): x, y, yaw'
        )
    if not pose.is_finite() or not np.isfinite(covariance).all():
        raise PriorError('prior holds NaN or infinity; expected finite x, y, yaw and covariance')
    if np.abs(covariance).max() > MAX_VARIANCE:
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
    least = max(MIN_VARIANCE, MIN_VARIANCE_RATIO * float(np.diag(symmetric)[:2].max()))
    floor = np.diag([least, least, MIN_VARIANCE])
    return Belief(stamp_ns, Pose2(pose.x, pose.y, wrap_angle(pose.yaw)), symmetric + floor)
