# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A part of the map, and its smoothed versions for cells of each size."""

from __future__ import annotations

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap

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

    def blurred_slopes(self, resolution: float) -> tuple[Floats, Floats]:
        """Slopes of `for_cells`, blurred by a cell of the part (`RasterMap.blurred_slopes`)."""
        if resolution not in self._calm:
            smoothed = self.for_cells(resolution)
            self._calm[resolution] = smoothed.blurred_slopes(self.part.resolution)
        return self._calm[resolution]
