# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Ranges of rows and columns of a map."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats


class CellRange(NamedTuple):
    """First row and the row after the last, first column and the column after the last."""

    row: int
    row_end: int
    col: int
    col_end: int


def averaged_per_side(cell: float) -> int:
    """Return how many cells of the map are averaged per side for cells of `cell` map cells."""
    return max(int(cell / 2.0 + 1e-9), 1)


def range_around(
    rc: Floats, shape: tuple[int, ...], *, pad: float, cell: float, snap: float
) -> CellRange | None:
    """
    Return the range around some points, clipped to the map.

    Parameters
    ----------
    rc : (n, 2) float64
        Rows and columns of the points.
    shape : (int, int)
        Rows and columns of the map.
    pad : float
        Cells of the map to add on every side.
    cell : float
        Side of the compared cells, cells of the map; three of them are added on every side.
    snap : float
        Cells of the map: the range starts at a multiple of it and has a whole multiple of it as
        length; 0: the smallest range.

    Returns
    -------
    CellRange or None
        Whole multiples of the averaged cells; None if less than two cells are on the map.

    """
    pad += 3.0 * max(cell, 1.0)
    low = np.floor(rc.min(axis=0) - pad).astype(int)
    high = np.ceil(rc.max(axis=0) + pad).astype(int) + 1
    step = averaged_per_side(cell)
    if snap:
        grain = max(round(snap / step), 1) * step
        length = (-((low - high) // grain) + 1) * grain
        low = low // grain * grain
        high = low + length
    low, high = np.clip(low, 0, shape), np.clip(high, 0, shape)
    high -= (high - low) % step
    if np.any(high - low < max(step, 2)):
        return None
    return CellRange(row=int(low[0]), row_end=int(high[0]), col=int(low[1]), col_end=int(high[1]))
