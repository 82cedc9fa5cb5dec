# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A view and its map window at one cell size, and the same on larger cells.

Downsampling adds weights up and averages values, of view and map alike; the lattice's step grows
with the cells, and its step in heading to what moves the view's corner by about as much. Values
are smoothed before, over as much as a larger cell: else a place half a larger cell from the
lattice, where the texture of cells looks unlike, is not seen on it.

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.cell_means import downsampled
from gip_localizer.core.match.lattice import Lattice, make_canvas, widened
from gip_localizer.core.pose import Pose2

# Anchor (m, m, rad) of the lattice of a plan, which does not depend on it.
ORIGIN = Pose2(0.0, 0.0, 0.0)
# Largest displacement (cells) of the corner of the view per yaw (design choice: 1.5, because most
# of the weight is nearer to the centre).
CORNER_STEP = 1.5
# Number of translations that are all scored instead of on larger cells (design choice: 200,
# because another level would take longer).
FEW_TRANSLATIONS = 200
# Least number of cells of the view on the largest cells (design choice: 450, because fewer cells
# cannot separate the best mode from the noise).
MIN_CELLS = 450
# Largest number of levels above the finest one (design choice: 4, because `MIN_CELLS` usually ends
# the pyramid before).
MAX_DOWNSAMPLINGS = 4


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

    @cached_property
    def everywhere(self) -> bool:
        """Whether the map is known on all of the window."""
        return bool(self.known.all())

    def downsampled(self, factor: int) -> Level:
        """Return the level with factor x factor cells averaged."""
        own = self.lattice
        plan = _plan(self.grid, own.step, own.half, own.yaws.tobytes(), own.pivot, factor)
        lattice = Lattice(own.anchor, plan.step, plan.half, own.yaws[plan.yaws], own.pivot)
        weight, values = self._view_downsampled(plan.grid, factor)
        window, known = self._window_downsampled(plan.wide, factor)
        return Level(
            plan.grid, values, weight, lattice, plan.canvas, window, known,
            plan.yaws.step * self.stride,
        )

    def _view_downsampled(self, larger: Grid, factor: int) -> tuple[Floats, Floats]:
        """Summed weights, and means by weight."""
        area = np.float32(factor * factor)
        shares = [
            downsampled(plane, factor, larger.shape, smooth=True)
            for plane in (self.weight, self.weight * self.values)
        ]
        values = shares[1] / np.maximum(shares[0], np.float32(1e-20) / area)
        return downsampled(self.weight, factor, larger.shape) * area, values

    def _window_downsampled(self, wide: Grid, factor: int) -> tuple[Floats, Floats]:
        fine = widened(self.canvas, self.lattice)
        top = round((wide.far - fine.far) / fine.resolution)
        left = round((wide.left - fine.left) / fine.resolution)
        everywhere = self.everywhere
        average = partial(downsampled, factor=factor, shape=wide.shape, corner=(top, left))
        values = average(self.window, smooth=True, replicate=everywhere)
        if everywhere:
            return values, np.ones(wide.shape, np.float32)
        known = (average(self.known) > 0.5).astype(np.float32)
        share = average(self.known, smooth=True)
        return values / np.maximum(share, np.float32(1e-6)) * known, known


@dataclass(frozen=True)
class _Plan:
    """Grids of larger cells, which are the same for every frame of a search."""

    grid: Grid
    canvas: Grid
    wide: Grid
    step: float
    half: tuple[int, int]
    yaws: slice


@lru_cache(maxsize=32)
def _plan(
    grid: Grid, step: float, half: tuple[int, int], yaws: bytes, pivot: float, factor: int
) -> _Plan:
    """Plan the averaging of a view's and a lattice's cells; yaws are float64."""
    headings = np.frombuffer(yaws)
    larger = Grid(
        grid.far, grid.left, math.ceil(grid.rows / factor), math.ceil(grid.cols / factor),
        grid.resolution * factor,
    )
    stride = _stride(grid, headings, pivot, factor)
    kept = slice((len(headings) // 2) % stride, None, stride)
    halves = (math.ceil(half[0] / factor), math.ceil(half[1] / factor))
    lattice = Lattice(ORIGIN, step * factor, halves, headings[kept], pivot)
    canvas = make_canvas(larger, lattice)
    return _Plan(larger, canvas, widened(canvas, lattice), lattice.step, halves, kept)


def _stride(grid: Grid, yaws: Floats, pivot: float, factor: int) -> int:
    """Yaws that may be left out where cells are `factor` times as large."""
    if len(yaws) < 3:
        return 1
    middle = grid.far - 0.5 * grid.rows * grid.resolution
    length = 0.5 * grid.rows * grid.resolution + abs(middle - pivot)
    corner = math.hypot(length, 0.5 * grid.cols * grid.resolution)
    step = CORNER_STEP * factor * grid.resolution / corner
    return max(min(int(step / float(yaws[1] - yaws[0])), len(yaws) // 2), 1)


def pyramid_levels(level: Level) -> list[Level]:
    """Return the level and those of larger cells, the largest cells first."""
    levels = [level]
    while len(levels) <= MAX_DOWNSAMPLINGS and (factor := _factor(levels[0])) > 1:
        levels.insert(0, levels[0].downsampled(factor))
    return levels


def _factor(level: Level) -> int:
    """Return the number of cells averaged per side: three if few translations remain."""
    cells = level.grid.rows * level.grid.cols
    translations = level.lattice.shape[1] * level.lattice.shape[2]
    if translations <= FEW_TRANSLATIONS or cells < 4 * MIN_CELLS:
        return 1
    return 3 if cells >= 9 * MIN_CELLS and translations <= 9 * FEW_TRANSLATIONS else 2
