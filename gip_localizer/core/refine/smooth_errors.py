# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Covariance of the pose from model errors that are smooth over the view.

An uneven road, a distorted map and a wrong calibration displace the content of the view by a
smooth field u(x, y). Neighbouring blocks of road therefore have correlated errors; if they were
treated as independent, the covariance would be too small. Block b, with matrix A_b and gradient
g_b of the least-squares problem, observes

    g_b = A_b θ + A_b[:, xy] u_b + n_b,      u ~ N(0, s² K),  n_b ~ N(0, ν A_b[xy, xy])

K is the sum of a map displacement, any direction, and of a road height, which displaces along the
ray; both are Gaussian fields of a correlation length. No single length or ratio s²/ν is selected:
the restricted likelihood of the gradients (θ and ν are integrated out, see Harville 1977) and the
level of earlier frames (`ErrorLevel`) weight them, and the covariance is the weighted mean. With
R = A⁻¹ Σ A_b[:, xy] F_b and K = F Fᵀ it is `E[s²] R Rᵀ`.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel

# Number of unknowns of the pose, which come first among all unknowns: x, y, yaw.
GEOMETRY = 3
# Correlation lengths of the fields, in units of the mean side of the view (design choice: doubling
# from a fifth, because shorter errors average out in a view and longer ones displace all of it).
LENGTHS = (0.22, 0.45, 0.9)
# Number of nodes along each side of the view on which the modes of a field are computed (design
# choice: 7, because their spacing is below the shortest correlation length).
NODES = 7
# Least variance of a mode that is kept, as a share of that of the largest mode (no unit; design
# choice: 0.02, because weaker modes hardly displace a pose and take time).
LEAST_MODE = 2e-2
# Grid of s²/ν times the mean information on u (no unit), over which the covariance is averaged
# (design choice: 1e-4 to 1e4, because fields at its ends have no effect or explain everything).
STRENGTHS = np.geomspace(1e-4, 1e4, 41)
# Information added to each block, as a share of the mean over the blocks (no unit; design choice:
# 0.02, because an edge does not constrain the displacement along itself).
LEAST_INFORMATION = 0.02
# Least share of the squared disagreement of the blocks that a field leaves unexplained (no unit;
# design choice: 0.05, because many modes may explain it by chance).
LEAST_REST = 0.05
# Least number of degrees of freedom of the disagreement of the blocks (design choice: 4, because
# above 2 its variance is finite).
LEAST_FREEDOM = 4.0


@dataclass(frozen=True, eq=False)
class BlockSums:
    """
    Matrix and gradient of a least-squares problem, for each block of road.

    Attributes
    ----------
    matrices : (blocks, p, p) float64
        A_b, symmetric.
    gradients : (blocks, p) float64
        g_b at the estimate.
    total : (p, p) float64
        Sum of A_b and of the prior.
    prior : (p,) float64
        Information of the prior on each unknown, for residuals of unit variance.

    """

    matrices: Floats
    gradients: Floats
    total: Floats
    prior: Floats


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """
    Errors of a match that later matches share.

    Attributes
    ----------
    covariance : (3, 3) float64
        Covariance of x, y (m) and yaw (rad) in the axes of the pose.
    level : ErrorLevel
        Level of the drive after this match.

    """

    covariance: Floats
    level: ErrorLevel


class SmoothErrors:
    """
    Smooth fields of displacement over a view.

    Parameters
    ----------
    centres : (blocks, 2) float64
        Centres of the blocks in base, metres.
    camera : (3,) float64
        Position of the camera in base, metres.

    """

    def __init__(self, centres: Floats, camera: Floats) -> None:
        sides = np.maximum(np.ptp(centres, axis=0), 1e-6)
        side = math.sqrt(float(sides[0] * sides[1]))
        self._min_distance = LENGTHS[0] * side
        levers = (centres - camera[:2]) / camera[2]
        levers /= max(math.sqrt(0.5 * float((levers**2).sum(axis=1).mean())), 1e-9)
        self._fields = [
            _displacements(_modes(centres, share * side), levers) for share in LENGTHS
        ]

    def shared(self, sums: BlockSums, level: ErrorLevel, place: Pose2) -> SharedErrors:
        """
        Return the smooth errors of a match.

        Parameters
        ----------
        sums : BlockSums
            The least-squares problem of the match.
        level : ErrorLevel
            Level of earlier frames.
        place : Pose2
            Pose of base in map.

        """
        blocks = _Whitened(sums)
        found = [blocks.strengths(fields) for fields in self._fields]
        variances = np.stack([variances for _, variances in found])
        logs = np.stack([logs for logs, _ in found]) + level.log_prior(STRENGTHS, variances)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        covariance = np.zeros((GEOMETRY, GEOMETRY))
        for fields, mean in zip(self._fields, (weights * variances).sum(axis=1), strict=True):
            shift = np.linalg.solve(sums.total, _field_gradient(sums.matrices, fields))[:GEOMETRY]
            covariance += mean * (shift @ shift.T)
        return SharedErrors(
            covariance, level.after(weights, variances, place, min_distance=self._min_distance)
        )


class _Whitened:
    """The blocks' gradients, transformed so that each independent error has variance ν."""

    def __init__(self, sums: BlockSums) -> None:
        of_xy = sums.matrices[:, :2, :2]
        information = 0.5 * np.trace(of_xy, axis1=1, axis2=2)
        least = LEAST_INFORMATION * max(float(information.mean()), 1e-30)
        values, axes = np.linalg.eigh(of_xy + least * np.eye(2))
        turn = (axes / np.sqrt(np.maximum(values, 0.5 * least))[:, None, :]).swapaxes(1, 2)
        self._to_fields = turn @ of_xy
        gradients = (turn @ sums.gradients[:, :2, None]).ravel()
        unknowns = sums.matrices.shape[1]
        self._design = (turn @ sums.matrices[:, :2, :]).reshape(-1, unknowns)
        counted = 2 * int(np.count_nonzero(information > 0.05 * least))
        self._freedom = max(counted - unknowns, LEAST_FREEDOM)
        spread = float(gradients @ gradients) / max(counted, 1)
        normal = self._design.T @ self._design
        ridge = 1e-9 * np.diag(normal) + 1e-12
        self._inverse = np.linalg.inv(normal + np.diag(spread * sums.prior + ridge))
        self._gradients = gradients
        gradient = self._design.T @ gradients
        self._estimate = self._inverse @ gradient
        self._squares = max(float(gradients @ gradients - gradient @ self._estimate), 1e-30)

    def strengths(self, fields: Floats) -> tuple[Floats, Floats]:
        """
        Return the log likelihood of each of `STRENGTHS`, and s² there, (n,) each.

        Parameters
        ----------
        fields : (blocks, 2, k)
            F.

        """
        columns = (self._to_fields @ fields).reshape(len(self._gradients), -1)
        crossed = self._design.T @ columns
        normal = columns.T @ columns - crossed.T @ self._inverse @ crossed
        gradient = columns.T @ self._gradients - crossed.T @ self._estimate
        values, axes = np.linalg.eigh(normal)
        values = np.maximum(values, 0.0)
        along = (axes.T @ gradient) ** 2
        strengths = STRENGTHS / max(float(values.mean()), 1e-30)
        grown = 1.0 + strengths[:, None] * values
        rest = self._squares - (strengths[:, None] * along / grown).sum(axis=1)
        rest = np.maximum(rest, LEAST_REST * self._squares)
        logs = -0.5 * (np.log(grown).sum(axis=1) + self._freedom * np.log(rest))
        return logs, strengths * rest / (self._freedom - 2.0)


def _modes(centres: Floats, length: float) -> Floats:
    """Return modes (blocks, k) of a Gaussian field of unit variance and a correlation length."""
    low, high = centres.min(axis=0), centres.max(axis=0)
    x, y = (np.linspace(a, b, NODES) for a, b in zip(low, high, strict=True))
    nodes = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    values, axes = np.linalg.eigh(_correlation(nodes, nodes, length))
    kept = values > LEAST_MODE * values[-1]
    return np.asarray(_correlation(centres, nodes, length) @ (axes[:, kept] / values[kept]**0.5))


def _correlation(a: Floats, b: Floats, length: float) -> Floats:
    distance_sq = ((a[:, None] - b[None]) ** 2).sum(axis=-1)
    return np.asarray(np.exp(-0.5 * distance_sq / length**2))


def _displacements(modes: Floats, levers: Floats) -> Floats:
    """Return F (blocks, 2, 3 k): along x, along y, and along the rays, of equal mean square."""
    none = np.zeros_like(modes)
    return np.concatenate([
        np.stack([modes, none], axis=1), np.stack([none, modes], axis=1),
        levers[:, :, None] * modes[:, None, :],
    ], axis=2)


def _field_gradient(matrices: Floats, fields: Floats) -> Floats:
    """Return the gradient (p, k) caused by unit fields."""
    columns = matrices[:, :2, :].reshape(-1, matrices.shape[2])
    return np.asarray(columns.T @ fields.reshape(len(columns), -1))
