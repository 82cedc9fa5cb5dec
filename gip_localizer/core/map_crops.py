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
from gip_localizer.core.footprints import Grid
from gip_localizer.core.pose import Pose2
from gip_localizer.core.raster_map import Box, RasterMap
from gip_localizer.core.windows import Extent

SNAP = 1.6  # m
KEPT = 4
BEYOND = 0.5  # m beyond the window, for the refinement's way
LOCKING = (0.0037, 0.0012)  # of a cell: what sampling may shift a pose by; on half cells
DOUBLED = (0.75, 2.0)  # sides of compared cells, in the map's, that meet a map of half its cells


class Crop:
    """
    A part of the map, and what cells of each size are compared with, made once.

    Parameters
    ----------
    part : RasterMap
        float32, as `RasterMap.crop` returns it.
    cell : float
        Side of the cells (m) that it is smoothed for.

    """

    def __init__(self, part: RasterMap, cell: float) -> None:
        self.part = part
        self._cell = cell
        self._smoothed: dict[float, RasterMap] = {}
        self._calm: dict[float, tuple[Floats, Floats]] = {}

    def for_cells(self, resolution: float) -> RasterMap:
        """Return the part smoothed for cells of a side (m), on half cells where that helps."""
        if resolution not in self._smoothed:
            smoothed = self.part.smoothed(resolution, self._cell)
            if self._is_doubled(resolution):
                smoothed = smoothed.doubled()
            self._smoothed[resolution] = smoothed
        return self._smoothed[resolution]

    def locking(self, resolution: float) -> float:
        """What sampling `for_cells` between its cell centres may shift a pose by, m."""
        share = LOCKING[self._is_doubled(resolution)]
        return share * self.for_cells(resolution).resolution

    def _is_doubled(self, resolution: float) -> bool:
        return DOUBLED[0] <= resolution / self.part.resolution < DOUBLED[1]

    def calm_slopes(self, resolution: float) -> tuple[Floats, Floats]:
        """Slopes of `for_cells`, blurred by a cell of the part (`RasterMap.blurred_slopes`)."""
        if resolution not in self._calm:
            smoothed = self.for_cells(resolution)
            self._calm[resolution] = smoothed.blurred_slopes(self.part.resolution)
        return self._calm[resolution]


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

    def about(self, grid: Grid, pose: Pose2, extent: Extent, cell: float) -> Crop | None:
        """
        Return the part that any candidate of a window may touch.

        Parameters
        ----------
        grid : Grid
            Of the view.
        pose : Pose2
            Middle of the window, base in map.
        extent : Extent
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
def _touched(grid: Grid, pose: Pose2, extent: Extent) -> Floats:
    """Corners (n, 2) of the view at the headings of the window, metres in the map."""
    turns = pose.yaw + np.linspace(-extent.yaw, extent.yaw, 2 + int(extent.yaw / 0.1))
    cos, sin = np.cos(turns), np.sin(turns)
    x, y = grid.outline().T[:, :, None]
    touched = np.stack([pose.x + cos * x - sin * y, pose.y + sin * x + cos * y], axis=-1)
    return touched.reshape(-1, 2)
