# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Versions of a map that cells of a given size are compared with."""

from __future__ import annotations

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import (
    averaged_noise,
    blurred,
    doubled,
    on_unit_scale,
    repeated,
    slopes,
    smoothed,
)


def smoothed_map(raster_map: RasterMap, cell: float, before: float) -> RasterMap:
    """
    Return the map (float32) smoothed for larger cells, at its own resolution.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    cell, before : float
        Side of the cells (m) that are compared, and for which `cut` has smoothed the map.

    """
    ratio, done = (max(side / raster_map.resolution, 1.0) for side in (cell, before))
    values, valid = smoothed(on_unit_scale(raster_map.grey), raster_map.valid, ratio, done)
    noise = None if raster_map.noise is None else averaged_noise(raster_map.noise, 1, ratio / done)
    return RasterMap(values, raster_map.resolution, raster_map.origin, valid, noise)


def blurred_slopes(raster_map: RasterMap, sigma: float) -> tuple[Floats, Floats]:
    """
    Return slopes of the map after a Gaussian filter, between each cell and the next ones.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    sigma : float
        Standard deviation of the filter, m.

    Returns
    -------
    (rows, cols) float32
        Slope down the rows, per cell; the map must be float32.
    (rows, cols) float32
        Slope to the right along the columns, per cell.

    """
    values, _ = blurred(raster_map.grey, raster_map.valid, sigma / raster_map.resolution)
    return slopes(values)


def doubled_map(raster_map: RasterMap) -> RasterMap:
    """
    Return the map (float32) on cells of half the side, by cubic splines.

    Bilinear interpolation blurs between cell centres and not at them, which biases a match
    towards one of them (peak locking). With cells of half the side this bias is small.

    """
    valid = None
    if raster_map.valid is not None:
        whole = cv2.erode(raster_map.valid.astype(np.uint8), np.ones((3, 3), np.uint8))
        valid = repeated(whole > 0)
    noise = None if raster_map.noise is None else repeated(raster_map.noise)
    values = doubled(on_unit_scale(raster_map.grey))
    return RasterMap(values, 0.5 * raster_map.resolution, raster_map.origin, valid, noise)
