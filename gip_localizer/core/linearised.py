# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
One linearised weighted least-squares problem: its step, its covariance, its quality.

With residual r, weights W (Gramian times trust), map slopes J and pixel blur S, the estimating
equation is `Jᵀ W r = 0` and its slope `Jᵀ W S J`. For white pixel noise that is maximum
likelihood; the sandwich `A⁻¹ B A⁻¹` with the gradients' spread B over blocks of road holds
whatever the residuals are.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats

GEOMETRY = 3  # x, y, yaw come first in the state
TRIMMED = 1.0 / 3.0  # share of the cells whose residuals tell the noise
TRIMMED_CHI_SQ = 0.1855  # that quantile of the chi-square distribution, 1 degree of freedom
BETTER_BLOCKS = 0.8  # quantile of the blocks' correlations that sets the standard
LEAST_TELLING = 0.02  # share of the weight that must stand out of the noise to tell
LEAST_PATTERN = 5e-4  # weighted standard deviation of a map that has any pattern
SHADING_RIDGE = 1e-3  # of the information on the gain
DAMPING = np.array([1.0, 1.0, 25.0])  # 1/m², 1/m², 1/rad²: no step along what nothing tells
WIDEST = np.array([30.0, 30.0, 3.0])  # m, m, rad: what is known of any pose near its start
SINGULAR = 1e-9  # least eigenvalue of an information matrix scaled to a unit diagonal
LEAST_SPREAD = 0.05  # of the noise model's standard deviations: residuals may be small by chance
TELLING = 0.35  # expected correlation below which a block's own says nothing


@dataclass(frozen=True, eq=False)
class Problem:
    """
    The problem at one state; n cells, p columns (x, y, yaw, camera motion, gain, offset).

    Attributes
    ----------
    instruments : (n, p) float32
        Slopes of the unblurred map for each column.
    slopes : (n, p) float32
        The same behind the pixel blur.
    residual : (n,) float32
        v - a S û - b.
    weights : (n,) float32
        Gramian times trust; 0 where the map holds no data.
    curvature : (n,) float32
        Slope of the weighted residual: what `weights` is to the step, this is to the spread.
    all_weights : (n,) float32
        Gramian alone.
    predicted : (n,) float32
        S û.
    gain, offset : float
        a and b.
    scale_sq : float
        Mean squared normalised residual of the cells that agree.
    prior : (p,) float64
        Information of the prior on each column, before scaling.
    prior_offset : (p,) float64
        State relative to the prior's mean.

    """

    instruments: Floats
    slopes: Floats
    residual: Floats
    weights: Floats
    curvature: Floats
    all_weights: Floats
    predicted: Floats
    gain: float
    offset: float
    scale_sq: float
    prior: Floats
    prior_offset: Floats

    def information(self) -> Floats:
        """Return `Jᵀ W S J` plus the prior, (p, p): the Gauss-Newton matrix."""
        return self._normal(self.weights)

    def _normal(self, weights: Floats) -> Floats:
        weighted = self.instruments * weights[:, None]
        matrix = (weighted.T @ self.slopes).astype(np.float64)
        matrix = 0.5 * (matrix + matrix.T)
        ridge = 1e-9 * np.diag(matrix) + 1e-12
        ridge[:GEOMETRY] += 1.0 / WIDEST**2
        return np.asarray(matrix + np.diag(self.scale_sq * self.prior + ridge))

    def step(self, information: Floats) -> Floats:
        """Return the Gauss-Newton step (p,)."""
        gradient = (self.instruments.T @ (self.weights * self.residual)).astype(np.float64)
        gradient -= self.scale_sq * self.prior * self.prior_offset
        damped = information.copy()
        damped[range(GEOMETRY), range(GEOMETRY)] += self.scale_sq * DAMPING
        return np.asarray(np.linalg.solve(damped, gradient))

    def sandwich(self, blocks: sparse.csr_matrix) -> Floats:
        """
        Return the covariance (3, 3) of the geometry from the gradients' spread.

        Never far below what the noise model expects, which is large along what nothing tells.

        """
        scores = np.asarray(
            blocks @ (self.instruments * (self.weights * self.residual)[:, None]), np.float64
        )
        slope = self._normal(self.curvature)
        count = int(np.count_nonzero(np.abs(scores).sum(axis=1)))
        spread = scores.T @ scores * (count / max(count - len(slope), 1))
        spread += np.diag(self.scale_sq**2 * self.prior)
        inverse = np.linalg.inv(slope)
        found = (inverse @ spread @ inverse)[:GEOMETRY, :GEOMETRY]
        return np.asarray(found + LEAST_SPREAD**2 * self.expected())

    def expected(self) -> Floats:
        """Return the covariance (3, 3) of the geometry that the noise model alone explains."""
        return _positive_inverse(self._normal(self.weights))[:GEOMETRY, :GEOMETRY]

    def overdispersion(self, covariance: Floats) -> float:
        """
        Standard deviations over those that the noise model alone explains (root mean square).

        Near 1 where view and map differ by the noise that is assumed; large where the parts of
        the view pull in different directions, as at a wrong place.

        """
        ratio = np.trace(np.linalg.solve(self.expected(), covariance)) / GEOMETRY
        return float(np.sqrt(max(ratio, 0.0)))

    def fisher(self) -> Floats:
        """Return the covariance (3, 3) of the geometry for independent pixel noise."""
        inverse = np.linalg.inv(self._normal(self.all_weights))
        return self.scale_sq * inverse[:GEOMETRY, :GEOMETRY]

    def mean_square(self) -> float:
        """Weighted mean square residual of the cells that agree."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()), 1e-20)

    def inliers(self) -> float:
        """Share of the weight that agrees with the map."""
        return float(self.weights.sum()) / max(float(self.all_weights.sum()), 1e-20)

    def correlation(self) -> float:
        """Weighted correlation of view and prediction over the cells that agree."""
        w = self.weights.astype(np.float64)
        total = w.sum()
        if total <= 0.0:
            return 0.0
        v = self.residual + self.gain * self.predicted + self.offset
        dv, dm = v - w @ v / total, self.predicted - w @ self.predicted / total
        if w @ dm**2 < LEAST_PATTERN**2 * total:
            return 0.0
        spread = np.sqrt((w @ dv**2) * (w @ dm**2))
        return float(w @ (dv * dm) / spread) if spread > 1e-12 else 0.0


def _positive_inverse(matrix: Floats) -> Floats:
    """Inverse of a symmetric matrix (p, p) whose least eigenvalues may be rounded below zero."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-30))
    values, vectors = np.linalg.eigh(matrix * np.outer(unit, unit))
    inverse = (vectors / np.maximum(values, SINGULAR)) @ vectors.T
    return np.asarray(inverse * np.outer(unit, unit))


def exposure(
    values: Floats, predicted: Floats, weights: Floats, *, least_gain: float
) -> tuple[float, float]:
    """Gain and offset of the view relative to the map, weighted least squares."""
    total = float(weights.sum())
    if total <= 0.0:
        return 1.0, 0.0
    mean_v, mean_m = float(weights @ values) / total, float(weights @ predicted) / total
    centred = weights * (predicted - np.float32(mean_m))
    gain = float(centred @ values) / max(float(centred @ predicted), 1e-12)
    gain = max(gain, least_gain)
    return gain, mean_v - gain * mean_m


def shading(values: Floats, predicted: Floats, weights: Floats, basis: Floats) -> Floats:
    """
    How the gain varies over the image (vignetting, a dirty lens), as factors of a basis.

    Parameters
    ----------
    values, predicted, weights : (n,) float32
        View, map behind the pixel blur, and weights.
    basis : (n, k) float32
        Smooth functions of the pixel, of order one.

    Returns
    -------
    (k,) float64
        Factors c of `v = a (1 + basis c) m + b`, shrunk towards none.

    """
    columns = np.column_stack([predicted, np.ones_like(predicted), basis * predicted[:, None]])
    weighted = columns * weights[:, None]
    normal = (weighted.T @ columns).astype(np.float64)
    ridge = np.zeros(len(normal))
    ridge[2:] = SHADING_RIDGE * normal[0, 0]
    solved = np.linalg.solve(
        normal + np.diag(ridge + 1e-12), (weighted.T @ values).astype(np.float64)
    )
    if solved[0] <= 0.0:
        return np.zeros(basis.shape[1])
    return np.clip(solved[2:] / solved[0], -0.5, 0.5)


def agreeing(
    values: Floats, predicted: Floats, weights: Floats, blocks: sparse.csr_matrix, *,
    gain: float | None = None,
) -> tuple[Floats, float]:
    """
    Tell the cells (n,) float32 0 or 1 in blocks of road whose pattern is the map's.

    The second value is the share of the weight, among the blocks whose pattern stands out of
    the noise, that is in such blocks: 0 where no block's does.

    Within a block brightness and contrast do not matter, so that cars, glare and patches show
    before the exposure is known. A block is kept if its correlation is at least half of what
    the noise lets expect; without a gain, half of what the better blocks reach.

    """
    columns = np.stack([
        weights, weights * values, weights * predicted, weights * values**2,
        weights * predicted**2, weights * values * predicted, weights > 0.0,
    ], axis=1)
    sums = np.asarray(blocks @ columns, np.float64)
    w = np.maximum(sums[:, 0], 1e-20)
    v, m = sums[:, 1] / w, sums[:, 2] / w
    var_v = np.maximum(sums[:, 3] / w - v**2, 0.0)
    var_m = np.maximum(sums[:, 4] / w - m**2, 0.0)
    alike = (sums[:, 5] / w - v * m) / np.maximum(np.sqrt(var_v * var_m), 1e-12)
    counted = sums[:, 0] > 0.0
    if not counted.any():
        return np.ones(len(values), np.float32), 0.0
    if gain is None:
        expected = np.full(len(w), np.quantile(alike[counted], BETTER_BLOCKS))
        telling, kept = counted, alike >= 0.5 * expected
    else:
        pattern = gain**2 * var_m
        expected = np.sqrt(pattern / (pattern + np.maximum(sums[:, 6], 1.0) / w))
        telling = counted & (expected >= TELLING) & (var_m > LEAST_PATTERN**2)
        kept = (alike >= 0.5 * expected) | ~telling
    share = float(w[telling & kept].sum() / max(w[telling].sum(), LEAST_TELLING * w.sum()))
    return np.asarray(blocks.T @ kept.astype(np.float32)), share


def mean_normalised_square(residual: Floats, weights: Floats) -> float:
    """Robust mean of r² W (1 when the weights are 1/variance), from its lower third."""
    part = slice(None, None, max(len(residual) // 2500, 1))
    chosen = weights[part] > 0.0
    if not chosen.any():
        return 1.0
    squares = residual[part][chosen] ** 2 * weights[part][chosen]
    rank = int(TRIMMED * (len(squares) - 1))
    return max(float(np.partition(squares, rank)[rank]) / TRIMMED_CHI_SQ, 1e-6)


def trust(
    residual: Floats, weights: Floats, scale_sq: float, outlier_scale: float
) -> tuple[Floats, Floats]:
    """
    Geman-McClure weights (n,), and the slope (n,) of residual times weight.

    Weights are near 1 for residuals within the scale and near 0 far outside.

    """
    ratio = residual**2 * weights * np.float32(1.0 / (outlier_scale**2 * scale_sq))
    weight = 1.0 / (1.0 + ratio) ** 2
    return np.asarray(weight), np.asarray(weight * (1.0 - 3.0 * ratio) / (1.0 + ratio))


def block_sums(points: Floats, side: tuple[float, float]) -> sparse.csr_matrix:
    """Matrix (blocks, n) that adds up the cells of each block of road, sides in metres."""
    index = np.floor((points - points.min(axis=0)) / np.array(side)).astype(int)
    _, block = np.unique(index[:, 0] * 100_000 + index[:, 1], return_inverse=True)
    block = np.asarray(block).ravel()
    n = len(points)
    ones = np.ones(n, np.float32)
    return sparse.csr_matrix((ones, (block, np.arange(n))), shape=(int(block.max()) + 1, n))
