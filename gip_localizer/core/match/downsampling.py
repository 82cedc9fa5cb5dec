# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The bird's-eye view on larger cells, for searching coarse to fine.

Downsampling adds weights up and averages values by weight, so nothing but detail is lost. Slow
brightness changes (vignetting, shade, dirt) are taken out of view and map alike before the
lattice is scored; what sticks out far (cars, glare) is clipped.

"""

from __future__ import annotations

import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats, median
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.cell_means import downsampled

LOCAL_MEAN_M = 1.0  # m: side of the square whose mean counts as brightness, not as pattern
CLIP = 4.0  # robust standard deviations


def downsampled_view(view: View, weight: Floats, factor: int) -> tuple[View, Floats]:
    """
    Average factor x factor cells: weights add up, values become weighted means.

    Returns
    -------
    view : View
        On cells `factor` times as large.
    weight : (rows, cols) float32
        Summed weights.

    """
    if factor == 1:
        return view, weight
    grid = view.grid
    shape = math.ceil(grid.rows / factor), math.ceil(grid.cols / factor)
    area = np.float32(factor**2)
    total, sums, footprint = (
        downsampled(plane, factor, shape) * area
        for plane in (weight, weight * view.patch, view.footprint)
    )
    patch = sums / np.maximum(total, np.float32(1e-20))
    larger = Grid(grid.far, grid.left, *shape, grid.resolution * factor)
    return View(patch, footprint, total > 0.0, larger), total


def locally_centred(values: Floats, weight: Floats, resolution: float) -> Floats:
    """
    Take the local mean out and clip what sticks out.

    Parameters
    ----------
    values : (rows, cols) float32
        Grey; ignored where the weight is 0.
    weight : (rows, cols) float32
        Above 0 where values count (only that is used).
    resolution : float
        Side of a cell, metres.

    Returns
    -------
    (rows, cols) float32
        Zero where the weight is 0.

    """
    known = (weight > 0.0).astype(np.float32)
    side = 2 * max(round(0.5 * LOCAL_MEAN_M / resolution), 1) + 1
    share = cv2.blur(known, (side, side), borderType=cv2.BORDER_CONSTANT)
    mean = cv2.blur(values * known, (side, side), borderType=cv2.BORDER_CONSTANT)
    centred = (values - mean / np.maximum(share, np.float32(1e-6))) * known
    counted = np.abs(centred[known > 0.0])
    if counted.size == 0:
        return np.asarray(centred)
    limit = np.float32(max(CLIP * median(counted) / 0.6745, 1e-6))
    return np.asarray(np.clip(centred, -limit, limit))
