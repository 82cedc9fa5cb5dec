# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The bird's-eye view on joined cells, for searching coarse to fine.

Joining adds weights up and averages values by weight, so nothing but detail is lost. Slow
brightness changes (vignetting, shade, dirt) are taken out of view and map alike before the
lattice is scored; what sticks out far (cars, glare) is clipped.

"""

from __future__ import annotations

from functools import cache
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats, median
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.kernels.library import address, AVAILABLE, kernels, row_address

LOCAL_MEAN_M = 1.0  # m: side of the square whose mean counts as brightness, not as pattern
CLIP = 4.0  # robust standard deviations


def coarsened(view: View, weight: Floats, factor: int) -> tuple[View, Floats]:
    """
    Join factor x factor cells: weights add up, values become weighted means.

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
    rows, cols = math.ceil(grid.rows / factor), math.ceil(grid.cols / factor)
    bottom, right = rows * factor - grid.rows, cols * factor - grid.cols

    def joined(values: Floats) -> Floats:
        padded = cv2.copyMakeBorder(values, 0, bottom, 0, right, cv2.BORDER_CONSTANT)
        means = cv2.resize(padded, (cols, rows), interpolation=cv2.INTER_AREA)
        return np.asarray(means * np.float32(factor**2))

    total = joined(weight)
    patch = joined(weight * view.patch) / np.maximum(total, np.float32(1e-20))
    larger = Grid(grid.far, grid.left, rows, cols, grid.resolution * factor)
    return View(patch, joined(view.footprint), total > 0.0, larger), total


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


def joined(
    values: Floats, factor: int, shape: tuple[int, int], *, corner: tuple[int, int] = (0, 0),
    smooth: bool = False, replicate: bool = False,
) -> Floats:
    """
    Return means over factor x factor cells.

    Parameters
    ----------
    values : (rows, cols) float32
        The smaller cells.
    factor : int
        Of them, per side of a larger one.
    shape : (int, int)
        Rows and columns of the larger cells.
    corner : (int, int)
        Rows and columns of smaller cells that the larger ones begin before the values; negative:
        behind their first.
    smooth : bool
        True: values are averaged over as much as a larger cell before.
    replicate : bool
        What lies beyond the values: True: is like their edge; False: is 0.

    Returns
    -------
    (rows, cols) float32
        A new array.

    """
    if AVAILABLE:
        return _by_loop(values, factor, shape, corner, smooth, replicate)
    border = cv2.BORDER_REPLICATE if replicate else cv2.BORDER_CONSTANT
    if smooth:
        kernel = _smoothing(factor)
        values = cv2.sepFilter2D(values, cv2.CV_32F, kernel, kernel, borderType=border)
    (top, left), (rows, cols) = corner, values.shape
    bottom, right = shape[0] * factor - top - rows, shape[1] * factor - left - cols
    inside = values[max(-top, 0) : rows + min(bottom, 0), max(-left, 0) : cols + min(right, 0)]
    padded = cv2.copyMakeBorder(
        inside, max(top, 0), max(bottom, 0), max(left, 0), max(right, 0), border
    )
    return np.asarray(cv2.resize(padded, shape[::-1], interpolation=cv2.INTER_AREA))


@cache
def _smoothing(factor: int) -> Floats:
    """Weights of a box of `factor` cells about the middle of a cell."""
    box = np.ones(factor, np.float32)
    return np.convolve(box, [0.5, 0.5]) / factor if factor % 2 == 0 else box / factor


@cache
def _taps(factor: int, smooth: bool) -> Floats:
    """Weights of the cells that make a larger one."""
    box = np.full(factor, 1.0 / factor)
    return (np.convolve(box, _smoothing(factor)) if smooth else box).astype(np.float32)


def _by_loop(
    values: Floats, factor: int, shape: tuple[int, int], corner: tuple[int, int], smooth: bool,
    replicate: bool,
) -> Floats:
    taps = _taps(factor, smooth)
    reach = (len(taps) - factor) // 2
    top, left = corner[0] + reach, corner[1] + reach
    (rows, cols), out = values.shape, np.empty(shape, np.float32)
    buffer = np.empty(2 * (factor * (shape[1] - 1) + len(taps)), np.float32)
    kernels().join_cells(
        row_address(values, np.float32), values.strides[0] // values.itemsize, rows, cols,
        top, left, address(taps, np.float32), len(taps), factor, replicate,
        address(buffer, np.float32), address(out, np.float32), *shape,
    )
    return out
