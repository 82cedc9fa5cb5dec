# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimates and ground truth, one row per frame: the arrays for metrics and charts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.evaluation.run import FrameResult
from gip_localizer.evaluation.wrong_bounds import DEFAULT_BOUNDS, WrongBounds
from gip_localizer.io.trajectory import Trajectory

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
ELLIPSE_95 = 5.991464547107979
"""95 % quantile of the chi-square law with 2 degrees of freedom (no unit): -2 ln 0.05."""


@dataclass(frozen=True, eq=False)
class ErrorTable:
    """
    Errors, one row per frame; NaN where the pose or the truth is missing.

    Attributes
    ----------
    stamps_ns : (n,) int64
        Image stamps.
    published : (n,) bool
        True where a pose was published.
    poses : (n, 3) float64
        Published poses: x, y [m], yaw [rad].
    truth : (n, 3) float64
        Ground truth, interpolated at the stamps.
    body : (n, 3) float64
        Estimate minus truth: longitudinal, lateral [m] in the axes of the true pose, yaw [rad].
    sigma : (n, 3) float64
        Reported standard deviations in the same axes.
    nees : (n,) float64
        eᵀ P⁻¹ e, 3 degrees of freedom.
    nees_xy : (n,) float64
        The same for the position, 2 degrees of freedom.
    bounds : WrongBounds
        Errors above which a published pose is wrong.

    """

    stamps_ns: NDArray[np.int64]
    published: Bools
    poses: Floats
    truth: Floats
    body: Floats
    sigma: Floats
    nees: Floats
    nees_xy: Floats
    bounds: WrongBounds

    @property
    def xy(self) -> Floats:
        """Distance between estimate and truth, (n,) metres."""
        return np.hypot(self.body[:, 0], self.body[:, 1])

    @property
    def judged(self) -> Bools:
        """True where a pose was published and the truth is known, (n,)."""
        return np.isfinite(self.xy)

    @property
    def wrong(self) -> Bools:
        """True where the error of a published pose exceeds a bound, (n,)."""
        yaw_deg = np.degrees(np.abs(self.body[:, 2]))
        return self.judged & ((self.xy > self.bounds.xy_m) | (yaw_deg > self.bounds.yaw_deg))


def tabulate_errors(
    estimates: Sequence[FrameResult], truth: Trajectory | None,
    bounds: WrongBounds = DEFAULT_BOUNDS,
) -> ErrorTable:
    """
    Compare estimates with the truth, which is interpolated in time, never aligned or extrapolated.

    Parameters
    ----------
    estimates : sequence of FrameResult
        Frames in any order of stamps.
    truth : Trajectory or None
        Trajectory of base in the map frame.
    bounds : WrongBounds
        Errors above which a published pose is wrong.

    Returns
    -------
    ErrorTable
        Row i belongs to estimate i.

    """
    count = len(estimates)
    stamps = np.array([estimate.stamp_ns for estimate in estimates], np.int64)
    poses = np.full((count, 3), np.nan)
    covariances = np.full((count, 3, 3), np.nan)
    for row, estimate in enumerate(estimates):
        if estimate.pose is not None:
            poses[row] = estimate.pose
        if estimate.pose is not None and estimate.covariance is not None:
            covariances[row] = estimate.covariance
    true = truth.at(stamps) if truth is not None else np.full((count, 3), np.nan)
    error = poses - true
    error[:, 2] = (error[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
    heading = np.where(np.isfinite(true[:, 2]), true[:, 2], poses[:, 2])
    to_body = _to_body(heading)
    in_body = to_body @ covariances @ np.transpose(to_body, (0, 2, 1))
    return ErrorTable(
        stamps_ns=stamps,
        published=np.array([estimate.pose is not None for estimate in estimates], np.bool_),
        poses=poses,
        truth=true,
        body=np.einsum('nij,nj->ni', to_body, error),
        sigma=np.sqrt(np.maximum(np.einsum('nii->ni', in_body), 0.0)),
        nees=_normalized_square(error, covariances),
        nees_xy=_normalized_square(error[:, :2], covariances[:, :2, :2]),
        bounds=bounds,
    )


def _to_body(yaw: Floats) -> Floats:
    turn = np.zeros((len(yaw), 3, 3))
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(yaw)
    turn[:, 0, 1], turn[:, 1, 0] = np.sin(yaw), -np.sin(yaw)
    turn[:, 2, 2] = 1.0
    return turn


def _normalized_square(error: Floats, covariance: Floats) -> Floats:
    """Return eᵀ P⁻¹ e per row, NaN where P is not positive definite."""
    result = np.full(len(error), np.nan)
    for row in np.flatnonzero(np.isfinite(error).all(1) & np.isfinite(covariance).all((1, 2))):
        try:
            half = np.linalg.solve(np.linalg.cholesky(covariance[row]), error[row])
        except np.linalg.LinAlgError:
            continue
        result[row] = half @ half
    return result
