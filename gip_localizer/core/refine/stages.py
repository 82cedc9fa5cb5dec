# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The stages of the refinement: the cells that each stage uses, coarse to fine."""

from __future__ import annotations

import cv2
import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.birdseye.suspension import SuspensionMotion
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.match.downsampling import downsampled_view
from gip_localizer.core.refine.blocks import Blocks, whole_blocks
from gip_localizer.core.refine.edge_noise import PixelSteps

# Number of cells averaged per side, and largest number of steps, per stage (design choice: 4, 2,
# 1, because larger cells widen the basin of convergence, and the last stage needs the most steps).
STAGES = ((4, 6), (2, 6), (1, 12))
# Number of steps of the first stage without outlier rejection (design choice: 2, because before
# them misalignment looks like outliers).
PLAIN_STEPS = 2
# Least variance of the residuals that outlier rejection assumes, in units of the variance of the
# noise model (design choice: 0.5, because smaller residuals are so by chance).
LEAST_SCALE_SQ = 0.5
# Sides (m ahead, m left) of the blocks within which residuals count as correlated (design choice:
# 1 m and 0.5 m, because errors of paint and texture extend about as far).
BLOCK_SIDES = (1.0, 0.5)
# Least number of blocks along each axis, for which blocks are made smaller in small views (design
# choice: 10, because a covariance from few blocks is uncertain).
LEAST_BLOCKS = 10
# Least number of larger blocks along each axis for which they alone are used (measured: the
# covariance needs seven, docs/accuracy.md).
ENOUGH_BLOCKS = 7
# Side (m) of the larger blocks, which agree or disagree with the map as a whole (measured: with
# blocks of 1.4 x 1 m a small camera accepted an image of another place, docs/accuracy.md).
PATTERN_SIDE = 1.0
# Least number of averaged cells of a stage, below which it is skipped (design choice: 200, because
# a step from fewer cells may leave the basin of convergence).
LEAST_CELLS = 200
# Number of functions in the optical basis: u, v, u², u v, v².
OPTICAL_TERMS = 5


def make_stages(rectifier: Rectifier) -> list[Stage]:
    """Return the stages for which the view has enough cells; the last one uses all cells."""
    cells = int(np.count_nonzero(rectifier.valid))
    return [
        Stage(rectifier, factor, steps) for factor, steps in STAGES
        if factor == 1 or cells >= LEAST_CELLS * factor**2
    ]


class Stage:
    """The cells of one stage: averaged by a factor, or all of them with the pixel blur."""

    def __init__(self, rectifier: Rectifier, factor: int, steps: int) -> None:
        self.factor = factor
        self.steps = steps
        self.plain = PLAIN_STEPS if factor == STAGES[0][0] else 0
        self.least_scale_sq = LEAST_SCALE_SQ * factor**2
        weight = rectifier.valid.astype(np.float32)
        blank = View(weight, rectifier.footprint, rectifier.valid, rectifier.grid)
        view, _ = downsampled_view(blank, weight, factor)
        self.resolution = view.grid.resolution
        self._shape = view.grid.shape
        index = np.flatnonzero(view.valid)
        points = view.grid.points() if factor > 1 else rectifier.centroids
        self.blocks = _blocks(points[index], rectifier.grid)
        self.index = index[self.blocks.order]
        self.suspension = SuspensionMotion(rectifier.camera, points[self.index])
        self.optical = optical_basis(rectifier.camera, points[self.index])
        self.blur: sparse.csr_matrix | None = None
        self.pixel_steps: PixelSteps | None = None
        if factor == 1:
            order = self.blocks.order
            self.blur = rectifier.pixel_blur[order][:, order]
            footprint = rectifier.footprint.ravel()[self.index]
            self.pixel_steps = PixelSteps(rectifier.camera, points[self.index], footprint)

    @property
    def block_centres(self) -> Floats:
        """Centres (blocks, 2) of the blocks in base, metres."""
        x, y = self.suspension.x, self.suspension.y
        sums = self.blocks.products(np.ones((1, len(x)), np.float32),
                                    np.stack([x, y, np.ones_like(x)]))[:, 0]
        return np.asarray(sums[:, :2] / sums[:, 2:])

    def on_grid(self, values: Floats) -> Floats:
        """Return values (n,) on the grid (rows, cols) float32; 0 in cells without a value."""
        grid = np.zeros(self._shape, np.float32)
        grid.reshape(-1)[self.index] = values
        return grid

    def of_grid(self, grid: Floats) -> Floats:
        """Return the values at the cells (n,) of a grid of the same road with any cell size."""
        rows, cols = self._shape
        fitted = cv2.resize(grid, (cols, rows), interpolation=cv2.INTER_LINEAR)
        return np.asarray(fitted).reshape(-1)[self.index]

    def blurred(self, values: Floats) -> Floats:
        """Return values (n,) after the pixel blur."""
        return values if self.blur is None else np.asarray(self.blur @ values)


def _blocks(points: Floats, grid: Grid) -> Blocks:
    extent = (grid.rows * grid.resolution, grid.cols * grid.resolution)
    ahead, left = (min(s, e / LEAST_BLOCKS) for s, e in zip(BLOCK_SIDES, extent, strict=True))
    per_larger = (whole_blocks(ahead, PATTERN_SIDE), whole_blocks(left, PATTERN_SIDE))
    larger = ahead * per_larger[0], left * per_larger[1]
    if all(e >= ENOUGH_BLOCKS * side for e, side in zip(extent, larger, strict=True)):
        return Blocks(points[:, 0], points[:, 1], larger, (1, 1))
    return Blocks(points[:, 0], points[:, 1], (ahead, left), per_larger)


def optical_basis(camera: CameraModel, points: Floats) -> Floats:
    """Return smooth functions (5, n) of the pixels that see road points, of order 1, mean 0."""
    uv, _ = camera.project(points.astype(np.float64))
    u = uv[:, 0] / (0.5 * camera.width) - 1.0
    v = uv[:, 1] / (0.5 * camera.width) - camera.height / camera.width
    basis = np.nan_to_num(np.stack([u, v, u * u, u * v, v * v], axis=1))
    return np.ascontiguousarray((basis - basis.mean(axis=0)).T, np.float32)
