# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The stages of the refinement: which cells it looks at, coarse to fine."""

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

STAGES = ((4, 6), (2, 6), (1, 12))  # cells averaged per side, and the most steps
PLAIN_STEPS = 2  # of the first stage, before outliers are told from misalignment
LEAST_SCALE_SQ = 0.5  # residuals this small against the noise model are never outliers
BLOCK_SIDES = (1.0, 0.5)  # m ahead, m left: residuals count as correlated within such blocks
LEAST_BLOCKS = 10  # along each axis, ...
ENOUGH_BLOCKS = 7  # ... unless there are so many of the larger ones
PATTERN_SIDE = 1.0  # m: larger blocks, which agree with the map or do not
LEAST_CELLS = 200  # averaged cells that a stage must have
OPTICAL_TERMS = 5


def make_stages(rectifier: Rectifier) -> list[Stage]:
    """Return the stages that the view has cells for; the last looks at all of them."""
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
        """Middles (blocks, 2) of the blocks in base, metres."""
        x, y = self.suspension.x, self.suspension.y
        sums = self.blocks.products(np.ones((1, len(x)), np.float32),
                                    np.stack([x, y, np.ones_like(x)]))[:, 0]
        return np.asarray(sums[:, :2] / sums[:, 2:])

    def on_grid(self, values: Floats) -> Floats:
        """Return values (n,) where their cells lie, (rows, cols) float32; 0 elsewhere."""
        grid = np.zeros(self._shape, np.float32)
        grid.reshape(-1)[self.index] = values
        return grid

    def of_grid(self, grid: Floats) -> Floats:
        """Return what a grid of the same road, in cells of any size, holds at the cells (n,)."""
        rows, cols = self._shape
        fitted = cv2.resize(grid, (cols, rows), interpolation=cv2.INTER_LINEAR)
        return np.asarray(fitted).reshape(-1)[self.index]

    def blurred(self, values: Floats) -> Floats:
        """Return values (n,) behind the pixel blur."""
        return values if self.blur is None else np.asarray(self.blur @ values)


def _blocks(points: Floats, grid: Grid) -> Blocks:
    extent = (grid.rows * grid.resolution, grid.cols * grid.resolution)
    ahead, left = (min(s, e / LEAST_BLOCKS) for s, e in zip(BLOCK_SIDES, extent, strict=True))
    joined = (whole_blocks(ahead, PATTERN_SIDE), whole_blocks(left, PATTERN_SIDE))
    larger = ahead * joined[0], left * joined[1]
    if all(e >= ENOUGH_BLOCKS * side for e, side in zip(extent, larger, strict=True)):
        return Blocks(points[:, 0], points[:, 1], larger, (1, 1))
    return Blocks(points[:, 0], points[:, 1], (ahead, left), joined)


def optical_basis(camera: CameraModel, points: Floats) -> Floats:
    """Smooth functions (5, n) of the pixels that see road points, of order one, mean zero."""
    uv, _ = camera.project(points.astype(np.float64))
    u = uv[:, 0] / (0.5 * camera.width) - 1.0
    v = uv[:, 1] / (0.5 * camera.width) - camera.height / camera.width
    basis = np.nan_to_num(np.stack([u, v, u * u, u * v, v * v], axis=1))
    return np.ascontiguousarray((basis - basis.mean(axis=0)).T, np.float32)
