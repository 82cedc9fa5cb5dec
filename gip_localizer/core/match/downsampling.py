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

from gip_localizer.core.arrays import Floats, upper_median
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.cell_means import downsampled

# Side (m) of the square whose mean counts as brightness and not as pattern (design choice: 1 m,
# because shadows and exposure vary over larger distances than paint).
LOCAL_MEAN_M = 1.0
# Number of robust standard deviations to which patterns are clipped (design choice: 4, because
# larger values come from cars and glare).
CLIP = 4.0
# The same number for `locally_normalized` (measured: 11 of 14 frames among cars are found with 1,
# and 4 with 4, docs/accuracy.md).
NORMALIZED_CLIP = 1.0
# Least local contrast, as a share of the mean one, to which patterns are normalized (no unit;
# design choice: 0.3, because less is noise, which must not become as strong as paint).
LEAST_CONTRAST = 0.3


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


def locally_centred(
    values: Floats, weight: Floats, resolution: float, clip: float = CLIP
) -> Floats:
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
    clip : float
        Robust standard deviations that may stick out.

    Returns
    -------
    (rows, cols) float32
        Zero where the weight is 0.

    """
    known = (weight > 0.0).astype(np.float32)
    centred = (values - _local_mean(values, known, resolution)) * known
    counted = np.abs(centred[known > 0.0])
    if counted.size == 0:
        return np.asarray(centred)
    limit = np.float32(max(clip * upper_median(counted) / 0.6745, 1e-6))
    return np.asarray(np.clip(centred, -limit, limit))


def locally_normalized(values: Floats, weight: Floats, resolution: float) -> Floats:
    """
    Give the pattern about every cell the same contrast: means and deviations are local ones.

    For a search without a prior: else the edges of cars and shadows, of many times the contrast
    of a road, decide where on a map a view fits best. Arguments and result as of
    `locally_centred`.

    """
    known = (weight > 0.0).astype(np.float32)
    centred = locally_centred(values, weight, resolution, clip=NORMALIZED_CLIP)
    power = _local_mean(centred**2, known, resolution)
    least = LEAST_CONTRAST**2 * float(power.sum()) / max(float(known.sum()), 1.0)
    return np.asarray(centred / np.sqrt(np.maximum(power, np.float32(max(least, 1e-12)))))


def _local_mean(values: Floats, known: Floats, resolution: float) -> Floats:
    """Mean over the known cells (1; others are 0) of a square about each cell."""
    side = 2 * max(round(0.5 * LOCAL_MEAN_M / resolution), 1) + 1
    share = cv2.blur(known, (side, side), borderType=cv2.BORDER_CONSTANT)
    total = cv2.blur(values * known, (side, side), borderType=cv2.BORDER_CONSTANT)
    return np.asarray(total / np.maximum(share, np.float32(1e-6)))
