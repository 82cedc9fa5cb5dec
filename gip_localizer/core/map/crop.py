# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A part of the map, and its smoothed versions for cells of each size."""

from __future__ import annotations

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.versions import blurred_slopes, doubled_map, smoothed_map

# Largest error of a pose by interpolation between cell centres (peak locking), in cells, for cells
# of the map and for cells of half their side (design choice: from errors over a map with cells of
# 5 cm).
LOCKING = (0.0037, 0.0012)
# Range of the side of compared cells, in cells of the map, in which the map is interpolated to
# cells of half the side (measured: for smaller cells it increases the error, docs/accuracy.md).
DOUBLED = (0.75, 2.0)


class Crop:
    """
    A part of the map, and its versions for cells of each size, which are made once.

    Parameters
    ----------
    part : RasterMap
        Part (float32), as `RasterMap.crop` returns it.
    cell : float
        Side (m) of the cells for which the part is smoothed.

    """

    def __init__(self, part: RasterMap, cell: float) -> None:
        self.part = part
        self._cell = cell
        self._smoothed: dict[float, RasterMap] = {}
        self._blurred: dict[float, tuple[Floats, Floats]] = {}

    def for_cells(self, resolution: float) -> RasterMap:
        """Return the part smoothed for cells of a side (m), on half cells within `DOUBLED`."""
        if resolution not in self._smoothed:
            smoothed = smoothed_map(self.part, resolution, self._cell)
            if self._is_doubled(resolution):
                smoothed = doubled_map(smoothed)
            self._smoothed[resolution] = smoothed
        return self._smoothed[resolution]

    def locking(self, resolution: float) -> float:
        """Return the largest error (m) of a pose by interpolation in `for_cells`."""
        share = LOCKING[self._is_doubled(resolution)]
        return share * self.for_cells(resolution).resolution

    def _is_doubled(self, resolution: float) -> bool:
        return DOUBLED[0] <= resolution / self.part.resolution < DOUBLED[1]

    def blurred_slopes(self, resolution: float) -> tuple[Floats, Floats]:
        """Return slopes of `for_cells`, blurred by a cell (`versions.blurred_slopes`)."""
        if resolution not in self._blurred:
            smoothed = self.for_cells(resolution)
            self._blurred[resolution] = blurred_slopes(smoothed, self.part.resolution)
        return self._blurred[resolution]
