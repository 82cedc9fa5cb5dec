# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
One linearised weighted least-squares problem: its step, its covariance, its quality.

With residual r, weights W (Gramian times robust weights), map slopes J and pixel blur S, the
estimating equation is `Jᵀ W r = 0` and its slope `Jᵀ W S J`. For white pixel noise that is maximum
likelihood. Where the error of a cell comes from the map and not from the pixels, instruments Z
replace J: `Zᵀ W r = 0`, with slope `Zᵀ W S J`. Z are the slopes of a blurred map. Between the
centres of its cells a map contains the position of an edge but not its shape, and sharp slopes
would shift all edges along the map's rows in the same direction. The covariance is estimated from
the influence of each block of road on the pose, which is valid for any noise of the residuals.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
import math

import numpy as np

from gip_localizer.core.arrays import Floats, product
from gip_localizer.core.refine.blocks import Blocks
from gip_localizer.core.refine.robust import LEAST_PATTERN
from gip_localizer.core.refine.smooth_errors import BlockSums, GEOMETRY

# Damping of a step (1/m², 1/m², 1/rad²) along directions that nothing constrains (chosen).
DAMPING = np.array([1.0, 1.0, 25.0])
# Standard deviations (m, m, rad) of a weak prior on every pose around its start (chosen).
WIDEST = np.array([30.0, 30.0, 3.0])
# Largest overdispersion, also returned where it cannot be computed (chosen).
MOST_OVERDISPERSION = 1e3
# Least eigenvalue of an information matrix scaled to a unit diagonal (chosen).
SINGULAR = 1e-9
# Least diagonal element for this scaling; at a wrong place elements may be negative (chosen).
LEAST_DIAGONAL = 1e-15
# Number of blocks subtracted from the effective number, as small-sample correction (chosen).
SMALL_SAMPLE = 0.5
# Largest leverage of a block that is corrected for (chosen).
MOST_LEVERAGE = 0.98
# Least standard deviation, as a share of the noise model's: residuals may be small by chance
# (chosen).
LEAST_SPREAD = 0.05


@dataclass(frozen=True, eq=False)
class LeastSquaresProblem:
    """
    The problem at one state; n cells, p unknowns (x, y, yaw, camera motion, gain, offset).

    Attributes
    ----------
    instruments : (p, n) float32
        Z, for each unknown.
    slopes : (p, n) float32
        S J: slopes of the map behind the pixel blur.
    exact : callable
        Returns J (p, n): slopes of the map as it is.
    scales : (p,) float64
        What the slopes are in grey levels of the view.
    residual : (n,) float32
        v - a S û - b.
    weights : (n,) float32
        Gramian times robust weights; 0 where the map holds no data.
    curvature : (n,) float32
        Slope of the weighted residual: what `weights` is to the step, this is to the spread.
    all_weights : (n,) float32
        Gramian alone.
    predicted : (n,) float32
        S û.
    pattern : callable
        Returns S û (n,), less what of it the light of the place explains.
    gain, offset : float
        a and b.
    scale_sq : float
        Mean squared normalised residual of the cells that agree.
    telling_scale_sq : float
        The same of the cells that tell the pose, each as far as it does, and no less: where only
        edges do, flat road says nothing of how well they fit. The prior is weighed by it.
    prior : (p,) float64
        Information of the prior on each unknown, before scaling.
    prior_offset : (p,) float64
        RefinementState relative to the prior's mean.

    """

    instruments: Floats
    slopes: Floats
    exact: Callable[[], Floats]
    scales: Floats
    residual: Floats
    weights: Floats
    curvature: Floats
    all_weights: Floats
    predicted: Floats
    pattern: Callable[[], Floats]
    gain: float
    offset: float
    scale_sq: float
    telling_scale_sq: float
    prior: Floats
    prior_offset: Floats

    @cached_property
    def information(self) -> Floats:
        """`Zᵀ W S J` plus the prior, (p, p): the Gauss-Newton matrix."""
        return self._normal(product(self.instruments * self.weights, self.slopes))

    def _normal(self, matrix: Floats) -> Floats:
        """Make a normal matrix of `Zᵀ W S J` (p, p)."""
        matrix = self._scaled(matrix)
        ridge = 1e-9 * np.diag(matrix) + 1e-12
        ridge[:GEOMETRY] += 1.0 / WIDEST**2
        return np.asarray(matrix + np.diag(self.telling_scale_sq * self.prior + ridge))

    def step(self, information: Floats) -> Floats:
        """Return the Gauss-Newton step (p,) with this matrix, or one near it."""
        gradient = self.scales * (self.instruments @ (self.weights * self.residual))
        gradient -= self.telling_scale_sq * self.prior * self.prior_offset
        damped = information.copy()
        damped[range(GEOMETRY), range(GEOMETRY)] += self.scale_sq * DAMPING
        return _solved(damped, gradient)

    def sums(self, blocks: Blocks) -> BlockSums:
        """Return the problem block by block."""
        columns = np.empty((len(self.slopes) + 1, self.slopes.shape[1]), np.float32)
        np.multiply(self.slopes, self.curvature, out=columns[:-1])
        np.multiply(self.weights, self.residual, out=columns[-1])
        sums = blocks.products(self.instruments, columns)
        return BlockSums(
            parts=self._scaled(sums[..., :-1]), pulls=sums[..., -1] * self.scales,
            whole=self._normal(sums[..., :-1].sum(axis=0)), prior=self.prior,
        )

    def block_covariance(self, sums: BlockSums) -> Floats:
        """
        Return the covariance (3, 3) of the pose from the influence of each block of road.

        A block moves the estimate by `A⁻¹ g_b`, with the whole slope A and its gradient g_b. One
        that decides alone has residuals that are small whatever its error is; its leverage makes
        up for that (Bell and McCaffrey 2002). Leaving the blocks out in turn, the jackknife, tells
        too much where blocks are few for the unknowns.

        Never far below what the noise model expects, which is large along what nothing tells.

        """
        moved = _moved(sums.whole, sums.parts, sums.pulls)[:, :GEOMETRY]
        held = _inverse(sums.whole)[:GEOMETRY]
        spread = moved.T @ moved + (held * (self.telling_scale_sq**2 * self.prior)) @ held.T
        few = _effective(moved, spread)
        spread *= few / max(few - SMALL_SAMPLE, 1.0)
        return np.asarray(spread + LEAST_SPREAD**2 * self.expected)

    def _scaled(self, matrix: Floats) -> Floats:
        """Symmetric part of matrices (..., p, p), in grey levels of the view."""
        return 0.5 * (matrix + matrix.swapaxes(-1, -2)) * np.outer(self.scales, self.scales)

    @cached_property
    def expected(self) -> Floats:
        """Covariance (3, 3) of the pose from the noise model alone."""
        return _positive_inverse(self.information)[:GEOMETRY, :GEOMETRY]

    def overdispersion(self, covariance: Floats) -> float:
        """
        Return the root-mean-square ratio of the standard deviations to the noise model's.

        Near 1 where view and map differ by the noise that is assumed; large where the parts of
        the view pull in different directions, as at a wrong place.

        """
        if not (np.isfinite(self.expected).all() and np.isfinite(covariance).all()):
            return MOST_OVERDISPERSION
        ratio = float(np.trace(_positive_inverse(self.expected) @ covariance)) / GEOMETRY
        return min(float(np.sqrt(max(ratio, 0.0))), MOST_OVERDISPERSION)

    def fisher(self) -> Floats:
        """Return the covariance (3, 3) of the geometry for independent pixel noise."""
        inverse = _inverse(
            self._normal(product(self.exact() * self.all_weights, self.slopes))
        )
        return self.scale_sq * inverse[:GEOMETRY, :GEOMETRY]

    def mean_square(self) -> float:
        """Weighted mean square residual of the cells that agree."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()), 1e-20)

    def inliers(self) -> float:
        """Share of the weight that agrees with the map."""
        return float(self.weights.sum()) / max(float(self.all_weights.sum()), 1e-20)

    def correlation(self) -> float:
        """Weighted correlation of the view's pattern and the map's over the cells that agree."""
        w, m = self.weights, self.pattern()
        total = float(w.sum(dtype=np.float64))
        if total <= 0.0:
            return 0.0
        v = self.residual + np.float32(self.gain) * m
        dv, dm = v - np.float32(w @ v / total), m - np.float32(w @ m / total)
        weighted = w * dm
        if weighted @ dm < LEAST_PATTERN**2 * total:
            return 0.0
        spread = math.sqrt(float((w * dv) @ dv) * float(weighted @ dm))
        return float(weighted @ dv) / spread if spread > 1e-12 else 0.0


def _effective(moved: Floats, covariance: Floats) -> float:
    """
    Return the effective number of blocks in a covariance; with few, it is small by chance.

    Parameters
    ----------
    moved : (blocks, 3)
        How far each block moves the pose.
    covariance : (3, 3)
        Sum of their squares.

    """
    shares = np.einsum('ij,ij->i', moved @ np.linalg.pinv(covariance), moved)
    return float(shares.sum() ** 2 / max(float((shares**2).sum()), 1e-30))


def _moved(whole: Floats, parts: Floats, pulls: Floats) -> Floats:
    """
    Return the influence (blocks, p) of each block on the estimate, corrected for its leverage.

    Of the errors' variance the fit leaves in a block the share 1 - h along an axis with leverage
    h, an eigenvalue of `A^-1/2 A_b A^-1/2`: its residuals pull too weakly by the root of that.

    Parameters
    ----------
    whole : (p, p)
        A.
    parts : (blocks, p, p)
        A_b.
    pulls : (blocks, p)
        g_b.

    """
    root = _inverse_root(whole)
    leverage, axes = np.linalg.eigh(root.T @ parts @ root)
    along = (axes.swapaxes(-1, -2) @ (pulls @ root)[..., None])[..., 0]
    along /= np.sqrt(1.0 - np.clip(leverage, 0.0, MOST_LEVERAGE))
    return np.asarray((axes @ along[..., None])[..., 0] @ root.T)


def _solved(matrix: Floats, right: Floats) -> Floats:
    """Solution of symmetric systems (..., p, p); the shortest one where they are singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, hermitian=True) @ right)


def _inverse(matrix: Floats) -> Floats:
    """Inverse of a symmetric matrix (p, p); the pseudo-inverse where it is singular."""
    return _solved(matrix, np.eye(len(matrix)))


def _positive_inverse(matrix: Floats) -> Floats:
    """Inverse of a symmetric matrix (p, p) whose least eigenvalues may be below zero."""
    root = _inverse_root(matrix)
    return np.asarray(root @ root.T)


def _inverse_root(matrix: Floats) -> Floats:
    """Root R (p, p) of that inverse: R Rᵀ."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), LEAST_DIAGONAL))
    values, vectors = np.linalg.eigh(matrix * np.outer(unit, unit))
    return np.asarray(unit[:, None] * (vectors / np.sqrt(np.maximum(values, SINGULAR))))
