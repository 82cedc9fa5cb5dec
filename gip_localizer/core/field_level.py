# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A view and its map window at one cell size, and the same with cells joined.

Joining adds weights up and averages values, of view and map alike; the lattice's step grows with
the cells, and its step in heading to what moves the view's corner by about as much.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.footprints import Grid
from gip_localizer.core.lattice import Lattice, make_canvas, widened

CORNER_STEP = 0.75  # cells that the view's corner may move from one yaw to the next


@dataclass(frozen=True, eq=False)
class Level:
    """
    What a search compares, at one cell size.

    Attributes
    ----------
    grid : Grid
        Cells of the view.
    values, weight : (rows, cols) float32
        The view and the Gramian's diagonal.
    lattice : Lattice
        The candidates; its step is the grid's resolution.
    canvas : Grid
        Cells that the turned view covers (`make_canvas`).
    window, known : (map rows, map cols) float32
        Map values, 0 where unknown, and 1 where known, on `widened(canvas, lattice)`.
    stride : int
        Yaws of the finest lattice per yaw of this one.

    """

    grid: Grid
    values: Floats
    weight: Floats
    lattice: Lattice
    canvas: Grid
    window: Floats
    known: Floats
    stride: int = 1

    def joined(self, factor: int) -> Level:
        """Return the level with factor x factor cells joined."""
        grid, weight, values = _joined_view(self, factor)
        stride = self._stride(factor)
        yaws = self.lattice.yaws
        middle = (len(yaws) // 2) % stride
        half_x, half_y = (math.ceil(n / factor) for n in self.lattice.half)
        lattice = replace(
            self.lattice, step=self.lattice.step * factor, yaws=yaws[middle::stride],
            half=(half_x, half_y),
        )
        canvas = make_canvas(grid, lattice)
        window, known = self._joined_window(widened(canvas, lattice), factor)
        return Level(grid, values, weight, lattice, canvas, window, known, stride * self.stride)

    def _stride(self, factor: int) -> int:
        """Yaws that may be left out where cells are `factor` times as large."""
        yaws, grid = self.lattice.yaws, self.grid
        if len(yaws) < 3:
            return 1
        middle = grid.far - 0.5 * grid.rows * grid.resolution
        length = 0.5 * grid.rows * grid.resolution + abs(middle - self.lattice.pivot)
        corner = math.hypot(length, 0.5 * grid.cols * grid.resolution)
        step = CORNER_STEP * factor * grid.resolution / corner
        return max(min(int(step / float(yaws[1] - yaws[0])), len(yaws) // 2), 1)

    def _joined_window(self, wide: Grid, factor: int) -> tuple[Floats, Floats]:
        fine = widened(self.canvas, self.lattice)
        top = round((wide.far - fine.far) / fine.resolution)
        left = round((wide.left - fine.left) / fine.resolution)
        size = (wide.cols, wide.rows)
        bottom = wide.rows * factor - top - fine.rows
        right = wide.cols * factor - left - fine.cols
        everywhere = bool(self.known.all())
        border = cv2.BORDER_REPLICATE if everywhere else cv2.BORDER_CONSTANT

        def joined(values: Floats) -> Floats:
            inside = values[max(-top, 0) : fine.rows + min(bottom, 0),
                            max(-left, 0) : fine.cols + min(right, 0)]
            padded = cv2.copyMakeBorder(
                inside, max(top, 0), max(bottom, 0), max(left, 0), max(right, 0), border
            )
            return np.asarray(cv2.resize(padded, size, interpolation=cv2.INTER_AREA))

        if everywhere:
            return joined(self.window), np.ones(wide.shape, np.float32)
        share = joined(self.known)
        known = (share > 0.5).astype(np.float32)
        return joined(self.window) / np.maximum(share, np.float32(0.5)) * known, known


def _joined_view(level: Level, factor: int) -> tuple[Grid, Floats, Floats]:
    """Grid, summed weights, and means by weight."""
    grid = level.grid
    rows, cols = math.ceil(grid.rows / factor), math.ceil(grid.cols / factor)
    bottom, right = rows * factor - grid.rows, cols * factor - grid.cols

    def joined(values: Floats) -> Floats:
        padded = cv2.copyMakeBorder(values, 0, bottom, 0, right, cv2.BORDER_CONSTANT)
        mean = cv2.resize(padded, (cols, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(mean * np.float32(factor * factor))

    weight = joined(level.weight)
    values = joined(level.weight * level.values) / np.maximum(weight, np.float32(1e-20))
    larger = Grid(grid.far, grid.left, rows, cols, grid.resolution * factor)
    return larger, weight, values
