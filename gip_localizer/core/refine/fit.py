# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A refined match: pose, covariance, and the agreement of view and map at the pose."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.smooth_errors import SharedErrors

# Distance (m) between two fits above which they are at different places (design choice: 0.2 m,
# because fits of one mode end closer together, and patterns of roads repeat at larger distances).
SAME_PLACE = 0.2
# Lever arm (m) that converts a rotation of the view into a displacement (design choice: 6 m, about
# the distance of the middle of a view from base).
LEVER = 6.0
# Largest correlation (no unit) in `Fit.evidence` (design choice: 0.9999, because the logarithm
# must stay finite).
MAX_CORRELATION = 0.9999


@dataclass(frozen=True, eq=False)
class Fit:
    """
    A refined match.

    Attributes
    ----------
    pose : Pose2
        Pose of base in map.
    own_covariance : (3, 3) float64
        Covariance of x, y (m) and yaw (rad) in the axes of the pose (ahead, left), without
        `shared`. It is computed from the influence of each block of road on the pose, so that
        correlated residuals do not count as independent, and increased by the share of the road
        that disagrees.
    find_shared : callable
        Computes `shared` from a level; it takes milliseconds and only few fits need it.
    level : ErrorLevel
        Level of the smooth errors in earlier frames.
    problem : LeastSquaresProblem
        The least-squares problem at the pose.
    camera_motion : (3,) float64
        Estimated pitch, roll (rad) and height (m) relative to the calibration.
    gain, offset : float
        Gain (no unit) and offset (grey levels of [0, 1]) of the view relative to the map.
    residual : float
        Weighted mean square of the residuals of the cells that agree.
    inliers : float
        Share of the weight in cells that agree with the map, 0..1.
    correlation : float
        Weighted correlation of view and blurred map over the cells that agree.
    agreement : float
        Share of the weight in blocks of road whose pattern agrees with the map, among the blocks
        whose pattern exceeds the noise, 0..1; 1 when outliers are not rejected.
    overlap : float
        Share of the weight on known map cells.
    converged : bool
        The last step was small, and the pose is near its start.
    overdispersion : float
        Ratio of the standard deviations to those of the noise model alone.
    chi_sq : float
        Mean of squared residuals over their expected variance (1 when the noise model holds).
    cell : float
        Side (m) of the cells of the view or of the map, whichever are larger.

    """

    pose: Pose2
    own_covariance: Floats
    find_shared: Callable[[ErrorLevel], SharedErrors]
    level: ErrorLevel
    problem: LeastSquaresProblem
    camera_motion: Floats
    gain: float
    offset: float
    residual: float
    inliers: float
    correlation: float
    agreement: float
    overlap: float
    converged: bool
    chi_sq: float
    overdispersion: float
    cell: float

    @property
    def fisher(self) -> Floats:
        """
        Covariance (3, 3) by Fisher information alone, in the axes of the pose.

        It is the Cramér-Rao bound for white pixel noise and the given weights.

        """
        return self.problem.fisher()

    @cached_property
    def shared(self) -> SharedErrors:
        """
        Errors that later frames share.

        They are smooth errors of road, map and calibration, and that of the calibrated camera yaw.

        """
        return self.find_shared(self.level)

    @cached_property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of x, y (m) and yaw (rad) in the axes of the pose."""
        return self.own_covariance + self.shared.covariance

    @property
    def covariance_in_map(self) -> Floats:
        """Covariance (3, 3) of x, y and yaw in the map's axes."""
        return self._in_map(self.covariance)

    @property
    def shared_in_map(self) -> Floats:
        """Symmetric root (3, 3) of the shared covariance, its rows turned to the map's axes."""
        values, axes = np.linalg.eigh(self.shared.covariance)
        root = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
        return np.asarray(self._turn() @ root)

    def _in_map(self, covariance: Floats) -> Floats:
        turn = self._turn()
        turned: Floats = turn @ covariance @ turn.T
        return 0.5 * (turned + turned.T)

    def _turn(self) -> Floats:
        turn = np.eye(3)
        turn[:2, :2] = self.pose.rotation()
        return turn

    def distance(self, other: Fit) -> float:
        """Return the distance to another fit, metres."""
        return self.pose.distance(other.pose)

    def along_weakest(self, distance: float) -> Pose2:
        """
        Return the motion (in the axes of the pose) that the view constrains least.

        Parameters
        ----------
        distance : float
            Its length, metres; a rotation counts as the displacement at the distance `LEVER`.

        """
        _, directions = self._by_strength
        ahead, left, turn = distance * directions[:, -1]
        return Pose2(float(ahead), float(left), float(turn) / LEVER)

    @property
    def anisotropy(self) -> float:
        """Ratio of the standard deviations along the least and the best constrained direction."""
        variances, _ = self._by_strength
        return math.sqrt(max(float(variances[-1]), 0.0) / max(float(variances[0]), 1e-30))

    @cached_property
    def _by_strength(self) -> tuple[Floats, Floats]:
        """Variances (3,) expected by the noise model, ascending, and their directions."""
        scale = np.diag([1.0, 1.0, LEVER])
        scaled = scale @ self.problem.expected @ scale
        if not np.isfinite(scaled).all():
            return np.zeros(3), np.eye(3)
        variances, directions = np.linalg.eigh(scaled)
        return variances, directions

    @property
    def evidence(self) -> float:
        """Log likelihood ratio per cell of the map to a blank road, `-ln(1 - c²)/2`."""
        unexplained = 1.0 - min(max(self.correlation, 0.0), MAX_CORRELATION) ** 2
        return -0.5 * math.log(unexplained)

    @property
    def fit_score(self) -> float:
        """
        Score by which fits at different places are compared.

        It is the evidence times the share of the road that agrees, so that a fit which matches
        only weak asphalt texture does not exceed one that matches the paint.

        """
        return self.agreement * self.evidence
