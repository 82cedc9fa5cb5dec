# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
One linearized weighted least-squares problem: its step, its covariance, and measures of its fit.

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
from gip_localizer.core.refine.block_influence import effective_blocks, influences
from gip_localizer.core.refine.blocks import Blocks
from gip_localizer.core.refine.robust import LEAST_PATTERN
from gip_localizer.core.refine.smooth_errors import BlockSums, GEOMETRY
from gip_localizer.core.refine.symmetric_systems import inverse, positive_inverse, solved

# Damping of a step (1/m², 1/m², 1/rad²; design choice: 1 and 25, because without it steps along
# directions that nothing constrains became arbitrarily long on a bare lane).
DAMPING = np.array([1.0, 1.0, 25.0])
# Standard deviations (m, m, rad) of a weak prior on every pose around its start (design choice: 30
# m and 3 rad, because they are far beyond any window and keep the matrix invertible).
WEAK_PRIOR = np.array([30.0, 30.0, 3.0])
# Largest overdispersion (no unit), also returned where it cannot be computed (design choice: 1e3,
# because it must stay finite).
MAX_OVERDISPERSION = 1e3
# Number of blocks that is subtracted from the effective number, as small-sample correction (design
# choice; `make sensitivity` shows its effect).
SMALL_SAMPLE = 0.5
# Least standard deviation, as a share of that of the noise model (no unit; design choice: 0.05,
# because residuals may be small by chance, and a match without slopes has no residuals at all).
MIN_SPREAD = 0.05


@dataclass(frozen=True, eq=False)
class LeastSquaresProblem:
    """
    The problem at one state; n cells, p unknowns (x, y, yaw, camera motion, gain, offset).

    Attributes
    ----------
    instruments : (p, n) float32
        Z, a row per unknown.
    slopes : (p, n) float32
        S J: slopes of the map behind the pixel blur.
    exact : callable
        Returns J (p, n): slopes of the map as it is.
    scales : (p,) float64
        Factors from the slopes of the map to grey levels of the view.
    residual : (n,) float32
        v - a S û - b.
    weights : (n,) float32
        Gramian times robust weights; 0 where the map holds no data.
    curvature : (n,) float32
        Derivative of the weighted residual; the covariance uses it in place of `weights`.
    all_weights : (n,) float32
        Gramian alone.
    predicted : (n,) float32
        S û.
    pattern : callable
        Returns the part (n,) of S û that the light model does not explain.
    gain, offset : float
        a and b.
    scale_sq : float
        Mean of r² W over the cells that agree.
    pose_scale_sq : float
        Mean of r² W, weighted by the information of each cell on the pose; at least `scale_sq`.
        Flat road fits at any pose, and would make the fit of the edges look too good. The prior
        is scaled by it.
    prior : (p,) float64
        Information of the prior on each unknown, before scaling.
    prior_offset : (p,) float64
        State relative to the mean of the prior.

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
    pose_scale_sq: float
    prior: Floats
    prior_offset: Floats

    @cached_property
    def information(self) -> Floats:
        """`Zᵀ W S J` plus the prior, (p, p): the Gauss-Newton matrix."""
        return self._normal(product(self.instruments * self.weights, self.slopes))

    def _normal(self, matrix: Floats) -> Floats:
        """Return the normal matrix: `Zᵀ W S J` (p, p), scaled, plus the prior."""
        matrix = self._scaled(matrix)
        ridge = 1e-9 * np.diag(matrix) + 1e-12
        ridge[:GEOMETRY] += 1.0 / WEAK_PRIOR**2
        return np.asarray(matrix + np.diag(self.pose_scale_sq * self.prior + ridge))

    def step(self, information: Floats) -> Floats:
        """Return the Gauss-Newton step (p,) for a matrix at this or a recent state."""
        gradient = self.scales * (self.instruments @ (self.weights * self.residual))
        gradient -= self.pose_scale_sq * self.prior * self.prior_offset
        damped = information.copy()
        damped[range(GEOMETRY), range(GEOMETRY)] += self.scale_sq * DAMPING
        return solved(damped, gradient)

    def sums(self, blocks: Blocks) -> BlockSums:
        """Return matrix and gradient of the problem for each block."""
        columns = np.empty((len(self.slopes) + 1, self.slopes.shape[1]), np.float32)
        np.multiply(self.slopes, self.curvature, out=columns[:-1])
        np.multiply(self.weights, self.residual, out=columns[-1])
        sums = blocks.products(self.instruments, columns)
        return BlockSums(
            matrices=self._scaled(sums[..., :-1]), gradients=sums[..., -1] * self.scales,
            total=self._normal(sums[..., :-1].sum(axis=0)), prior=self.prior,
        )

    def block_covariance(self, sums: BlockSums) -> Floats:
        """
        Return the covariance (3, 3) of the pose from the influence of each block of road.

        A block moves the estimate by `A⁻¹ g_b`, with the matrix A of all blocks and the gradient
        g_b of the block. A block that alone determines an unknown has small residuals whatever
        its error is; the correction for leverage accounts for it (`influences`). The jackknife,
        which leaves out one block at a time, overestimates the covariance when blocks are few.

        The result is never far below the covariance of the noise model, which is large along
        directions that nothing constrains.

        """
        influence = influences(sums.total, sums.matrices, sums.gradients)[:, :GEOMETRY]
        gain = inverse(sums.total)[:GEOMETRY]
        spread = influence.T @ influence
        spread = spread + (gain * (self.pose_scale_sq**2 * self.prior)) @ gain.T
        blocks = effective_blocks(influence, spread)
        spread *= blocks / max(blocks - SMALL_SAMPLE, 1.0)
        return np.asarray(spread + MIN_SPREAD**2 * self.expected)

    def _scaled(self, matrix: Floats) -> Floats:
        """Return the symmetric part of matrices (..., p, p), scaled to grey levels of the view."""
        return 0.5 * (matrix + matrix.swapaxes(-1, -2)) * np.outer(self.scales, self.scales)

    @cached_property
    def expected(self) -> Floats:
        """Covariance (3, 3) of the pose from the noise model alone."""
        return positive_inverse(self.information)[:GEOMETRY, :GEOMETRY]

    def overdispersion(self, covariance: Floats) -> float:
        """
        Return the root-mean-square ratio of the standard deviations to those of the noise model.

        It is near 1 where view and map differ by the assumed noise; it is large where the parts of
        the view contradict each other, as at a wrong place.

        """
        if not (np.isfinite(self.expected).all() and np.isfinite(covariance).all()):
            return MAX_OVERDISPERSION
        ratio = float(np.trace(positive_inverse(self.expected) @ covariance)) / GEOMETRY
        return min(float(np.sqrt(max(ratio, 0.0))), MAX_OVERDISPERSION)

    def fisher(self) -> Floats:
        """Return the covariance (3, 3) of the geometry for independent pixel noise."""
        information = self._normal(product(self.exact() * self.all_weights, self.slopes))
        return self.scale_sq * inverse(information)[:GEOMETRY, :GEOMETRY]

    def mean_square(self) -> float:
        """Return the weighted mean square residual of the cells that agree."""
        return float(self.weights @ self.residual**2) / max(float(self.weights.sum()), 1e-20)

    def inliers(self) -> float:
        """Return the share of the weight that agrees with the map."""
        return float(self.weights.sum()) / max(float(self.all_weights.sum()), 1e-20)

    def correlation(self) -> float:
        """Return the weighted correlation of the patterns of view and map in cells that agree."""
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
