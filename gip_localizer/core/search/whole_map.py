# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The whole map on the large cells of its search, and a view's candidates all over it."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.downsampling import downsampled_view, locally_normalized
from gip_localizer.core.match.lattice import Lattice, make_canvas, map_window, widened
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.pose import Pose2
from gip_localizer.core.threads import check_end

# Number of cells of the map that are averaged at once (design choice: 4,000,000, which are 16 MB
# of float32).
STRIP_CELLS = 4_000_000


@dataclass(frozen=True, eq=False)
class WholeMap:
    """
    A map averaged to the cells of a search.

    Attributes
    ----------
    middle : Pose2
        Centre of the map, with the axes of its grid.
    grid : Grid
        The cells, in the axes of `middle`; its edges are whole cells away from it.
    values : (rows, cols) float32
        Grey, or its pattern of equal contrast (`locally_normalized`); 0 where unknown.
    known : (rows, cols) float32
        1 where the map holds data, 0 elsewhere.
    patterned : bool
        Whether the values are the pattern.

    """

    middle: Pose2
    grid: Grid
    values: Floats
    known: Floats
    patterned: bool

    def level(self, view: View, weight: Floats, yaw_step: float) -> Level:
        """
        Return the search of a view at every place and heading.

        If the values are patterns, unknown cells count as road without a pattern, which explains
        nothing of a view; else they count as unknown.

        Parameters
        ----------
        view, weight : View, (rows, cols) float32
            Bird's-eye view and the Gramian's diagonal, on cells that divide those of the map.
        yaw_step : float
            Step in heading, rad, at most.

        """
        step = self.grid.resolution
        factor = max(round(step / view.grid.resolution), 1)
        view, weight = downsampled_view(view, weight, factor)
        grid, values = view.grid, view.patch
        if self.patterned:
            values = locally_normalized(values, weight, step)
        lattice = self._lattice(grid, weight, yaw_step)
        canvas = make_canvas(grid, lattice)
        wide = widened(canvas, lattice)
        window = self._on(wide, lattice.anchor, self.values)
        known = (
            np.ones_like(window) if self.patterned else self._on(wide, lattice.anchor, self.known)
        )
        return Level(grid, values, weight, lattice, canvas, window, known)

    def _lattice(self, grid: Grid, weight: Floats, yaw_step: float) -> Lattice:
        """Return candidates whose middle of the weight lies anywhere on the map."""
        step = grid.resolution
        ahead = grid.points()[:, 0].astype(np.float32)
        pivot = float(weight.ravel() @ ahead) / max(float(weight.sum()), 1e-20)
        # by less than a cell off the middle, so that the cells of view and map are the same
        x = round((grid.far - pivot) / step) * step - grid.far
        y = round(grid.left / step) * step - grid.left
        count = math.ceil(2.0 * math.pi / yaw_step)
        yaws = (np.arange(count) / count - 0.5) * 2.0 * math.pi
        half = (self.grid.rows // 2, self.grid.cols // 2)
        return Lattice(self.middle @ Pose2(x, y, 0.0), step, half, yaws, pivot)

    def _on(self, wide: Grid, anchor: Pose2, cells: Floats) -> Floats:
        """Return cells of the map on a grid at an anchor, 0 beyond the map."""
        offset = self.middle.inverse() @ anchor
        step = self.grid.resolution
        top = round((wide.far + offset.x - self.grid.far) / step)
        left = round((wide.left + offset.y - self.grid.left) / step)
        out = np.zeros(wide.shape, np.float32)
        part = cells[max(-top, 0) : wide.rows - top, max(-left, 0) : wide.cols - left]
        first = max(top, 0), max(left, 0)
        out[first[0] : first[0] + part.shape[0], first[1] : first[1] + part.shape[1]] = part
        return out


def average_map(raster_map: RasterMap, cell: float, *, patterned: bool) -> WholeMap:
    """
    Average a map to large cells strip by strip, so that no copy of it is needed.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    cell : float
        Side of the large cells, m.
    patterned : bool
        True: keep only the pattern.

    """
    width, height = raster_map.size_m
    middle = raster_map.origin @ Pose2(0.5 * width, 0.5 * height, 0.0)
    half = math.ceil(0.5 * width / cell), math.ceil(0.5 * height / cell)
    grid = Grid(half[0] * cell, half[1] * cell, 2 * half[0], 2 * half[1], cell)
    values = np.zeros(grid.shape, np.float32)
    known = np.zeros(grid.shape, np.float32)
    cells_of_row = raster_map.grey.size / grid.rows
    rows = max(int(STRIP_CELLS / cells_of_row), 1)
    for first in range(0, grid.rows, rows):
        check_end()
        part = slice(first, min(first + rows, grid.rows))
        strip = Grid(grid.far - first * cell, grid.left, part.stop - first, grid.cols, cell)
        crop = raster_map.crop(middle.transform(strip.outline()), margin=0.0, cell=cell)
        if crop is not None:
            values[part], known[part] = map_window(crop, strip, middle)
        raster_map.release()  # the system maps more of a file than is used
    values *= known
    if patterned:
        values = locally_normalized(values, known, cell)
    return WholeMap(middle, grid, values, known, patterned)
