# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Errors of the poses of a drive, from frames that see the same road.

The errors are modelled as stationary Gaussian processes along the driven path, independent in x,
y and heading, with a squared exponential correlation. A pair of frames shows the difference of
their errors, and the heading error of the later frame times the distance between them. Standard
deviations and correlation length are averaged over their posterior on a grid, from the joint
density of all pairs that are no outliers. A camera that is mounted a little otherwise than
calibrated adds disagreements that grow with the distance between the frames, the same for all
pairs; they are no errors of the poses. What is common to the whole drive, as a constant offset,
no pair shows.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
import math

import numpy as np
from scipy.linalg import block_diag

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.map.accuracy import MapAccuracy

SIGMAS_XY = np.geomspace(2e-4, 0.5, 24)
"""Examined standard deviations of x and y, metres; chosen: from a map without error to none."""
SIGMAS_YAW = np.geomspace(2e-5, 0.03, 16)
"""Examined standard deviations of the heading, rad; chosen in the same way."""
LENGTHS = np.geomspace(1.0, 32.0, 6)
"""Examined correlation lengths, metres driven; chosen: from bumps to the seconds over which
inertial navigation bridges."""
EXPECTED_YAW = 0.005
"""Upper part of the expected standard deviations of the heading, rad; chosen: 0.3 degrees. That
of x and y is the side of a cell. Larger ones need pairs that show them."""
CALIBRATION = 0.1
"""Standard deviation of the disagreement from the calibration per metre between the frames, m/m;
chosen: wide enough for 10 % of the height."""
OUTLIER_SHARE = 0.05
"""Prior share of pairs with a pose that does not belong to the drive (a jump); chosen."""
OUTLIER_SIGMAS = np.array([0.5, 0.5, 0.05])
"""Standard deviations of the errors of such a pair: m, m, rad; chosen."""
OUTLIER = 0.5
"""Probability from which a pair counts as an outlier: the more probable case."""


@dataclass(frozen=True)
class Pair:
    """
    Two frames that see the same road, and how far their poses disagree; map axes.

    Attributes
    ----------
    stamps_ns : (int, int)
        Of the earlier and the later frame.
    driven : (float, float)
        Metres driven from the first frame of the drive to each.
    lever : (float, float)
        Position of the earlier frame less that of the later one, metres.
    disagreement : (3,) float64
        Pose of the earlier frame on the map of the later one, less its given pose: m, m, rad.
    covariance : (3, 3) float64
        Of the measurement.

    """

    stamps_ns: tuple[int, int]
    driven: tuple[float, float]
    lever: tuple[float, float]
    disagreement: Floats
    covariance: Floats


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """
    Estimate of the errors of the poses of a drive.

    Attributes
    ----------
    accuracy : MapAccuracy
        Root mean square errors.
    drift : (2,) float64
        Disagreement from the calibration of the camera per metre between two frames: ahead and
        left, m/m.
    drift_sigma : float
        Its standard deviation.
    length : float
        Correlation length of the errors, metres driven (geometric mean of its posterior).
    outliers : tuple of Pair
        Pairs that disagree by more than such errors explain.

    """

    accuracy: MapAccuracy
    drift: Floats
    drift_sigma: float
    length: float
    outliers: tuple[Pair, ...]


def estimate_pose_errors(pairs: Sequence[Pair], cell: float) -> PoseErrors:
    """
    Estimate the errors of the poses from the disagreement of pairs.

    Parameters
    ----------
    pairs : sequence of Pair
        At least one.
    cell : float
        Side of a map cell, metres: poses of a survey are expected to be no worse.

    """
    outlying = _outlying(pairs, cell)
    usual = [pair for pair, out in zip(pairs, outlying, strict=True) if not out] or list(pairs)
    settings, log_density = _grid_log_density(usual, cell)
    weight = _weights(log_density)
    drift, drift_sigma = _drift(usual, settings[np.argmax(weight)])
    return PoseErrors(
        accuracy=MapAccuracy(*(math.sqrt(float(weight @ settings[:, k] ** 2)) for k in (0, 1))),
        drift=drift, drift_sigma=drift_sigma,
        length=math.exp(float(weight @ np.log(settings[:, 2]))),
        outliers=tuple(pair for pair, out in zip(pairs, outlying, strict=True) if out),
    )


def _outlying(pairs: Sequence[Pair], cell: float) -> Bools:
    """Return which pairs belong to a wide distribution rather than to that of the others."""
    drift = _median_drift(pairs)
    left = [replace(pair, disagreement=pair.disagreement - _per_metre([pair]) @ drift)
            for pair in pairs]
    usual = np.stack([_grid_log_density([pair], cell, 0.0)[1] for pair in left], axis=1)
    odd = np.array([_log_normal(pair.disagreement, pair.covariance + np.diag(OUTLIER_SIGMAS**2))
                    for pair in left])
    usual, odd = usual + math.log(1.0 - OUTLIER_SHARE), odd + math.log(OUTLIER_SHARE)
    mixed = np.logaddexp(usual, odd)
    return np.asarray(_weights(mixed.sum(axis=1)) @ np.exp(odd - mixed) > OUTLIER)


def _median_drift(pairs: Sequence[Pair]) -> Floats:
    """Return the median over the pairs of the disagreement per metre (2,): ahead, left."""
    per_metre = [_per_metre([pair]) for pair in pairs]
    squares = np.array([float(np.sum(columns[:, 0] ** 2)) for columns in per_metre])
    far = np.flatnonzero(squares >= 0.25 * np.median(squares))
    each = [per_metre[k].T @ pairs[k].disagreement / max(squares[k], 1e-12)
            for k in far.tolist()]
    return np.asarray(np.median(each, axis=0))


def _weights(log_density: Floats) -> Floats:
    density = np.exp(log_density - log_density.max())
    return np.asarray(density / density.sum())


def _grid_log_density(
    pairs: Sequence[Pair], cell: float, calibration: float = CALIBRATION
) -> tuple[Floats, Floats]:
    """
    Return the posterior density of the settings of the grid, for all pairs together.

    Parameters
    ----------
    pairs, cell
        As for `estimate_pose_errors`.
    calibration : float
        Standard deviation of the drift, m/m.

    Returns
    -------
    (n, 3) float64
        Sigma of x and y, sigma of the heading, correlation length.
    (n,) float64
        Log density, less a constant.

    """
    disagreement = np.concatenate([pair.disagreement for pair in pairs])
    per_metre = calibration * _per_metre(pairs)
    measured = block_diag(*(pair.covariance for pair in pairs)) + per_metre @ per_metre.T
    sigmas = np.stack(np.meshgrid(SIGMAS_XY, SIGMAS_YAW, indexing='ij'), axis=-1).reshape(-1, 2)
    expected = -0.5 * np.sum((sigmas / (cell, EXPECTED_YAW)) ** 2, axis=1)
    settings, densities = [], []
    for length in LENGTHS:
        units = np.stack(_unit_covariances(pairs, length))
        covariance = measured + np.tensordot(sigmas**2, units, axes=1)
        densities.append(expected + _log_normal(disagreement, covariance))
        settings.append(np.column_stack([sigmas, np.full(len(sigmas), length)]))
    return np.concatenate(settings), np.concatenate(densities)


def _per_metre(pairs: Sequence[Pair]) -> Floats:
    """Return the disagreement (3n, 2) of pairs for a drift of 1 m/m: ahead, left."""
    ahead = np.array([(*pair.lever, 0.0) for pair in pairs])
    left = np.array([(-pair.lever[1], pair.lever[0], 0.0) for pair in pairs])
    return -np.column_stack([ahead.ravel(), left.ravel()])


def _drift(pairs: Sequence[Pair], setting: Floats) -> tuple[Floats, float]:
    """Return the drift (2,), m/m, for one setting of the grid, and its larger sigma."""
    of_xy, of_yaw = _unit_covariances(pairs, float(setting[2]))
    covariance = (
        block_diag(*(pair.covariance for pair in pairs))
        + setting[0] ** 2 * of_xy + setting[1] ** 2 * of_yaw
    )
    per_metre = _per_metre(pairs)
    weighed = np.linalg.solve(covariance, per_metre)
    spread = np.linalg.inv(per_metre.T @ weighed + np.eye(2) / CALIBRATION**2)
    disagreement = np.concatenate([pair.disagreement for pair in pairs])
    return spread @ weighed.T @ disagreement, math.sqrt(float(np.diag(spread).max()))


def _unit_covariances(pairs: Sequence[Pair], length: float) -> tuple[Floats, Floats]:
    """Return covariances (3n, 3n) of disagreements from errors of 1 m and of 1 rad."""
    driven = np.array([pair.driven for pair in pairs]).ravel()  # earlier, later, earlier, ...
    correlation = np.exp(-0.5 * (np.subtract.outer(driven, driven) / length) ** 2)
    count = len(pairs)
    x, y, yaw = (np.zeros((count, 3, count, 2)) for _ in range(3))
    for k, pair in enumerate(pairs):
        x[k, 0, k] = y[k, 1, k] = yaw[k, 2, k] = (-1.0, 1.0)
        yaw[k, 0, k, 1], yaw[k, 1, k, 1] = -pair.lever[1], pair.lever[0]
    of_x, of_y, of_yaw = (
        part.reshape(3 * count, -1) @ correlation @ part.reshape(3 * count, -1).T
        for part in (x, y, yaw)
    )
    return of_x + of_y, of_yaw


def _log_normal(error: Floats, covariance: Floats) -> Floats:
    """Return the log density of an error (n,) for covariances (..., n, n), less a constant."""
    root = np.linalg.cholesky(covariance)
    white = np.linalg.solve(root, np.broadcast_to(error[:, None], (*root.shape[:-1], 1)))[..., 0]
    log_root = np.log(np.diagonal(root, axis1=-2, axis2=-1)).sum(axis=-1)
    return np.asarray(-0.5 * np.sum(white**2, axis=-1) - log_root)
