# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The map of the road: a grey raster with a resolution and an origin.

Only this file converts metres to cells. Row 0 of the array is the top of the image (largest
y of the grid); the origin is the pose, in the map frame, of the lower-left corner of the
lower-left cell (nav2 map_server), and cell centres lie half a cell inside.

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math
import mmap
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey, WHITE
from gip_localizer.core.map.accuracy import EXACT, MapAccuracy
from gip_localizer.core.map.bilinear import corners, Samples
from gip_localizer.core.map.cell_range import averaged_per_side, CellRange, range_around
from gip_localizer.core.map.map_check import check_map
from gip_localizer.core.map.resampling import (
    averaged_noise,
    contrast,
    downsampled_known,
    on_unit_scale,
    smoothed,
)
from gip_localizer.core.pose import Pose2


@dataclass(frozen=True, eq=False)
class RasterMap:
    """
    A grey map in a map frame.

    Attributes
    ----------
    grey : (rows, cols) uint8, uint16 or float32
        Brightness; full scale (255, 65535 or 1.0) is white.
    resolution : float
        Side of a cell, metres.
    origin : Pose2
        Pose of the lower-left corner of the lower-left cell in the map frame.
    valid : (rows, cols) bool or None
        Cells that hold data; None: all.
    noise : (rows, cols) uint8, uint16 or float32, or None
        Standard deviation of each cell's grey, on the full scale of the grey; None: unknown.
    accuracy : MapAccuracy
        Of the place of the road in the map; a part that was cut out counts as exact.

    Raises
    ------
    MapError
        Empty array, unknown dtype, NaN or infinity (unknown cells are marked in `valid`), or a
        resolution that is not positive.

    """

    grey: Grey
    resolution: float
    origin: Pose2 = Pose2(0.0, 0.0, 0.0)
    valid: Bools | None = None
    noise: Grey | None = None
    accuracy: MapAccuracy = EXACT

    def __post_init__(self) -> None:
        """Check the attributes (raises MapError)."""
        check_map(self.grey, self.resolution, self.origin, self.valid, self.noise)

    def release(self) -> None:
        """Release the memory of the used parts, if the map is mapped from disk."""
        for array in (self.grey, self.valid, self.noise):
            pages: Any = array
            while isinstance(pages, (np.ndarray, memoryview)):
                pages = pages.base if isinstance(pages, np.ndarray) else pages.obj
            if isinstance(pages, mmap.mmap) and hasattr(mmap, 'MADV_DONTNEED'):
                pages.madvise(mmap.MADV_DONTNEED)

    @cached_property
    def contrast(self) -> float:
        """Standard deviation of the grey over the known cells, of full scale."""
        return contrast(self.grey, self.valid)

    @property
    def size_m(self) -> tuple[float, float]:
        """Width and height of the grid, metres."""
        rows, cols = self.grey.shape
        return cols * self.resolution, rows * self.resolution

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """Least x, least y, largest x, largest y of the grid's corners in the map frame."""
        width, height = self.size_m
        corners = self.origin.transform(
            np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
        )
        low, high = corners.min(axis=0), corners.max(axis=0)
        return float(low[0]), float(low[1]), float(high[0]), float(high[1])

    def to_cell(self, xy_map: Floats) -> Floats:
        """Fractional (..., 2) row and column of map points; cell centres are integers."""
        local = self.origin.inverse().transform(xy_map)
        rows = self.grey.shape[0]
        row = rows - 0.5 - local[..., 1] / self.resolution
        col = local[..., 0] / self.resolution - 0.5
        return np.stack([row, col], axis=-1)

    def to_map(self, rc: Floats) -> Floats:
        """Map points (..., 2) of fractional rows and columns; the inverse of `to_cell`."""
        rc = np.asarray(rc, float)
        rows = self.grey.shape[0]
        local = np.stack([rc[..., 1] + 0.5, rows - 0.5 - rc[..., 0]], axis=-1) * self.resolution
        return self.origin.transform(local)

    def contains(self, xy_map: Floats) -> Bools:
        """Return which map points (..., 2) lie on the grid, with or without data."""
        rc = self.to_cell(np.asarray(xy_map, float)) + 0.5
        rows, cols = self.grey.shape
        inside: Bools = (
            (rc[..., 0] >= 0) & (rc[..., 0] < rows) & (rc[..., 1] >= 0) & (rc[..., 1] < cols)
        )
        return inside

    def crop(self, xy_map: Floats, *, margin: float, cell: float) -> RasterMap | None:
        """
        Return the part of the map around some points, as float32, smoothed for a cell size.

        Parameters
        ----------
        xy_map : (n, 2) float64
            Points of the map frame that the part must contain.
        margin : float
            Metres to add on every side.
        cell : float
            Side of the cells (m) that will be compared with the part. If they are larger than
            those of the map, the map is smoothed (with the second moment of the box), and
            downsampled if they are more than twice as large.

        Returns
        -------
        RasterMap or None
            None if no point is on the map.

        """
        cells = self.cell_range(xy_map, margin=margin, cell=cell)
        return None if cells is None else self.cut(cells, cell)

    def cell_range(
        self, xy_map: Floats, *, margin: float, cell: float, snap: float = 0.0
    ) -> CellRange | None:
        """
        Return rows and columns of the part around some points.

        Parameters
        ----------
        xy_map, margin, cell
            As for `crop`.
        snap : float
            Step (m): ranges start at multiples of it and have whole multiples as lengths, so that
            neighbouring places share a range. 0: the smallest range.

        """
        return range_around(
            self.to_cell(xy_map), self.grey.shape, pad=margin / self.resolution,
            cell=cell / self.resolution, snap=snap / self.resolution,
        )

    def cut(self, cells: CellRange, cell: float) -> RasterMap:
        """Return the part in a range of cells (`cell_range`), as `crop` does."""
        step = averaged_per_side(cell / self.resolution)
        part = (slice(cells.row, cells.row_end), slice(cells.col, cells.col_end))
        values = on_unit_scale(self.grey[part])
        valid = None if self.valid is None else np.asarray(self.valid[part])
        if valid is not None and valid.all():
            valid = None
        resolution = self.resolution * step
        corner = self.to_map(np.array([cells.row_end - 0.5, cells.col - 0.5]))
        noise = None
        if self.noise is not None:
            noise = averaged_noise(self.noise[part], step, cell / resolution)
        if step > 1:
            values, valid = downsampled_known(values, valid, step)
        values, valid = smoothed(values, valid, cell / resolution)
        origin = Pose2(float(corner[0]), float(corner[1]), self.origin.yaw)
        return RasterMap(values, resolution, origin, valid, noise)

    def sample(self, xy_map: Floats) -> tuple[Floats, Bools]:
        """
        Return the grey at map points, bilinear between cell centres.

        Parameters
        ----------
        xy_map : (n, 2) float64
            Metres in the map frame.

        Returns
        -------
        values : (n,) float32
            In [0, 1]; 0 where not valid.
        valid : (n,) bool
            On the grid, and all contributing cells have data.

        """
        samples = self.sample_from(Pose2(0.0, 0.0, 0.0), xy_map[:, 0], xy_map[:, 1])
        return samples.values, samples.known

    def sample_from(self, T_map_a: Pose2, x: Floats, y: Floats) -> Samples:
        """
        Return the grey at points of a frame, with slopes along the axes of this frame.

        Parameters
        ----------
        T_map_a : Pose2
            Pose of the frame in the map.
        x, y : (n,) float32 or float64
            Metres in the frame.

        Returns
        -------
        Samples
            Bilinear between cell centres.

        """
        row, col, T_grid_a = self._cells_from(T_map_a, x, y)
        found = corners(self.grey, self.valid, row, col)
        return Samples(found, WHITE[self.grey.dtype], self.resolution, T_grid_a.yaw)

    def _cells_from(self, T_map_a: Pose2, x: Floats, y: Floats) -> tuple[Floats, Floats, Pose2]:
        """Fractional rows and columns of points of frame a, and a's pose in the grid."""
        T_grid_a = self.origin.inverse() @ T_map_a
        kind = x.dtype.type
        cos = kind(math.cos(T_grid_a.yaw) / self.resolution)
        sin = kind(math.sin(T_grid_a.yaw) / self.resolution)
        col = cos * x - sin * y + kind(T_grid_a.x / self.resolution - 0.5)
        row = kind(self.grey.shape[0] - 0.5 - T_grid_a.y / self.resolution) - sin * x - cos * y
        return row, col, T_grid_a
