# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Parts of the map about the vehicle, kept while it stays near.

Boxes are snapped to a coarse grid, so that which part serves a place depends on the place alone
and not on the way there, and a vehicle cuts a new one every few frames only.

"""

from __future__ import annotations

from collections import OrderedDict
from functools import lru_cache

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.map.crop import Crop
from gip_localizer.core.map.raster_map import Box, RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.search.whole_map import average_map, WholeMap
from gip_localizer.core.search.window import SearchWindow

SNAP = 1.6  # grid to which boxes are snapped, m; chosen
KEPT = 4  # parts that are kept; chosen
BEYOND = 0.5  # margin around the window for the steps of the refinement, m; chosen




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
        self._kept: OrderedDict[tuple[Box, float], Crop] = OrderedDict()
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
        Return the part that any candidate of a window may touch.

        Parameters
        ----------
        grid : Grid
            Of the view.
        pose : Pose2
            Middle of the window, base in map.
        extent : SearchWindow
            Size of the window.
        cell : float
            Side of the cells (m) that will be compared with it.

        Returns
        -------
        Crop or None
            None where the window lies off the map.

        """
        box = self.raster_map.box(
            _touched(grid, pose, extent), margin=float(np.hypot(extent.x, extent.y)) + BEYOND,
            cell=cell, snap=SNAP,
        )
        if box is None:
            return None
        key = (box, cell)
        if key not in self._kept:
            self._kept[key] = Crop(self.raster_map.cut(box, cell), cell)
            self.raster_map.release()  # systems map much more of a file than is looked at
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
