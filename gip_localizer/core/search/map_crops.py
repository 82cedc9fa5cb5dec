# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Parts of the map around the vehicle, which are kept for later frames.

Ranges of cells are snapped to a coarse grid, so that the part depends only on the place and not
on the way to it, and so that a vehicle needs a new part only every few frames.

"""

from __future__ import annotations

from collections import OrderedDict
from functools import lru_cache

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.map.cell_range import CellRange
from gip_localizer.core.map.crop import Crop
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.search.whole_map import average_map, WholeMap
from gip_localizer.core.search.window import SearchWindow

# Step (m) of the grid to which ranges are snapped (design choice: 1.6 m, because a vehicle then
# needs a new part only every few frames).
SNAP = 1.6
# Number of parts that are kept (design choice: 4, for the cell sizes of one place and the last
# one).
KEPT = 4
# Margin (m) around the window (design choice: 0.5 m, because the steps of the refinement may leave
# the window).
MARGIN = 0.5


class MapCrops:
    """
    Cuts parts out of a map, and keeps the last few.

    Parameters
    ----------
    raster_map : RasterMap
        The whole map.

    """

    def __init__(self, raster_map: RasterMap) -> None:
        self.raster_map = raster_map
        self._kept: OrderedDict[tuple[CellRange, float], Crop] = OrderedDict()
        self._whole: tuple[tuple[float, bool], WholeMap] | None = None

    def whole(self, cell: float, *, patterned: bool) -> WholeMap:
        """Return the whole map on large cells (m), made at the first search."""
        key = (cell, patterned)
        if self._whole is None or self._whole[0] != key:
            self._whole = None
            self._whole = key, average_map(self.raster_map, cell, patterned=patterned)
        return self._whole[1]

    def about(self, grid: Grid, pose: Pose2, extent: SearchWindow, cell: float) -> Crop | None:
        """
        Return the part of the map that contains the view at every candidate of a window.

        Parameters
        ----------
        grid : Grid
            Grid of the view.
        pose : Pose2
            Pose of base in map at the centre of the window.
        extent : SearchWindow
            Size of the window.
        cell : float
            Side (m) of the cells that will be compared with the part.

        Returns
        -------
        Crop or None
            None if the window is outside the map.

        """
        cells = self.raster_map.cell_range(
            _touched(grid, pose, extent), margin=float(np.hypot(extent.x, extent.y)) + MARGIN,
            cell=cell, snap=SNAP,
        )
        if cells is None:
            return None
        key = (cells, cell)
        if key not in self._kept:
            self._kept[key] = Crop(self.raster_map.cut(cells, cell), cell)
            self.raster_map.release()  # the system maps more of a file than is used
            if len(self._kept) > KEPT:
                self._kept.popitem(last=False)
        self._kept.move_to_end(key)
        return self._kept[key]


@lru_cache(maxsize=4)
def _touched(grid: Grid, pose: Pose2, extent: SearchWindow) -> Floats:
    """Corners (n, 2) of the view at the headings of the window, metres in the map."""
    turns = pose.yaw + np.linspace(-extent.yaw, extent.yaw, 2 + int(extent.yaw / 0.1))
    cos, sin = np.cos(turns), np.sin(turns)
    x, y = grid.outline().T[:, :, None]
    touched = np.stack([pose.x + cos * x - sin * y, pose.y + sin * x + cos * y], axis=-1)
    return touched.reshape(-1, 2)
