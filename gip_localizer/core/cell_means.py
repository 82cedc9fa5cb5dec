# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells of a view or a map averaged into larger ones: by the compiled loop, or by OpenCV."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.kernels.binding import AVAILABLE
from gip_localizer.core.kernels.library import average_cells


def downsampled(
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
        Number of smaller cells per side of a larger one.
    shape : (int, int)
        Rows and columns of the larger cells.
    corner : (int, int)
        Number of smaller rows and columns by which the larger cells begin before the values;
        negative: after their first.
    smooth : bool
        True: values are averaged over the size of a larger cell before.
    replicate : bool
        Values outside the array: True: those of its edge; False: 0.

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
    """Return weights of a box of `factor` cells around the centre of a cell."""
    box = np.ones(factor, np.float32)
    return np.convolve(box, [0.5, 0.5]) / factor if factor % 2 == 0 else box / factor


@cache
def _taps(factor: int, smooth: bool) -> Floats:
    """Return weights of the cells in a larger cell."""
    box = np.full(factor, 1.0 / factor)
    return (np.convolve(box, _smoothing(factor)) if smooth else box).astype(np.float32)


def _by_loop(
    values: Floats, factor: int, shape: tuple[int, int], corner: tuple[int, int], smooth: bool,
    replicate: bool,
) -> Floats:
    taps = _taps(factor, smooth)
    reach = (len(taps) - factor) // 2
    top, left = corner[0] + reach, corner[1] + reach
    return average_cells(values, taps, factor, (top, left), shape, replicate=replicate)
