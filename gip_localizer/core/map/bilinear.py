# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Bilinear samples of a grid of cells, with the slopes between the same four cells."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey, Ints


@dataclass(frozen=True, eq=False)
class Corners:
    """
    The four cells about each of n points.

    Attributes
    ----------
    index : (n,) int
        The upper left one, in the flattened grid.
    a, b, c, d : (n,) float32
        Upper left, upper right, lower left, lower right.
    down, right : (n,) float32
        Where the point lies between them, 0..1.
    valid : (n,) bool or None
        On the grid, and all four cells hold data; None: all of the points.

    """

    index: Ints
    a: Floats
    b: Floats
    c: Floats
    d: Floats
    down: Floats
    right: Floats
    valid: Bools | None

    def values(self) -> Floats:
        """Bilinear values (n,) float32; of the nearest cells where a point is not valid."""
        top = self.a + self.right * (self.b - self.a)
        bottom = self.c + self.right * (self.d - self.c)
        return np.asarray(top + self.down * (bottom - top))

    def slopes(self) -> tuple[Floats, Floats]:
        """Slopes (n,) float32 per cell, down the rows and right along the columns."""
        left, right = self.c - self.a, self.d - self.b
        over = self.b - self.a
        return left + self.right * (right - left), over + self.down * (right - left)


class Samples:
    """
    Grey of a map at n points of a frame.

    Attributes
    ----------
    values : (n,) float32
        In [0, 1]; 0 where not valid.
    valid : (n,) bool or None
        On the grid, and all of the cells that contribute hold data; None: all of the points.

    """

    def __init__(self, found: Corners, white: float, resolution: float, yaw: float) -> None:
        self.valid = found.valid
        self._found, self._resolution, self._yaw = found, resolution, yaw
        self._scale: Any = np.float32(1.0 / white)
        if self.valid is not None:
            self._scale = self.valid * self._scale
        self.values: Floats = found.values() * self._scale

    @property
    def known(self) -> Bools:
        """Which of the points are valid, (n,) bool."""
        return np.ones(len(self.values), bool) if self.valid is None else self.valid

    def slopes(self) -> tuple[Floats, Floats]:
        """Slopes (n,) float32 along x and y of the frame, per metre; 0 where not valid."""
        return self._along_frame(*self._found.slopes())

    def slopes_of(self, down: Floats, right: Floats) -> tuple[Floats, Floats]:
        """
        Slopes (n,) float32 of another grid of the same cells, as `slopes` gives them.

        Parameters
        ----------
        down, right : (rows, cols) float32
            Slopes per cell in the middle of each cell and its neighbours below and right.

        """
        index = self._found.index
        return self._along_frame(down.reshape(-1).take(index), right.reshape(-1).take(index))

    def nearest_of(self, cells: Floats) -> Floats:
        """What another grid (rows, cols) of the same cells holds about each point, (n,)."""
        return cells.reshape(-1).take(self._found.index)

    def _along_frame(self, down: Floats, right: Floats) -> tuple[Floats, Floats]:
        scale = self._scale * np.float32(1.0 / self._resolution)
        cos, sin = np.float32(math.cos(self._yaw)), np.float32(math.sin(self._yaw))
        return (cos * right - sin * down) * scale, (-sin * right - cos * down) * scale


def corners(grey: Grey, known: Bools | None, row: Floats, col: Floats) -> Corners:
    """
    Look up the cells about points of a grid.

    Parameters
    ----------
    grey : (rows, cols) uint8, uint16 or float32
        The grid.
    known : (rows, cols) bool or None
        Cells that hold data; None: all.
    row, col : (n,) float32 or float64
        Points; cell centres are integers. Up to half a cell outside counts as the edge.

    """
    rows, cols = grey.shape
    row, col, valid = _inside(row, col, rows, cols)
    r0 = np.minimum(row.astype(np.int32), max(rows - 2, 0))
    c0 = np.minimum(col.astype(np.int32), max(cols - 2, 0))
    down, right = (
        (k - k0.astype(k.dtype)).astype(np.float32, copy=False) for k, k0 in ((row, r0), (col, c0))
    )
    index = r0.astype(np.intp) * cols + c0
    step = 1 if cols > 1 else 0
    below = cols if rows > 1 else 0
    steps = (0, step, below, below + step)
    flat = grey.reshape(-1)
    a, b, c, d = (
        flat[shift:].take(index).astype(np.float32, copy=False) for shift in steps
    )
    if known is not None:
        holds = known.reshape(-1)
        data = np.logical_and.reduce([holds[shift:].take(index) for shift in steps])
        valid = data if valid is None else data & valid
    return Corners(index, a, b, c, d, down, right, valid)


def _inside(
    row: Floats, col: Floats, rows: int, cols: int
) -> tuple[Floats, Floats, Bools | None]:
    """Return rows and columns clipped to the grid, and which were on it (None: all)."""
    above = row.size and row.min() >= 0 and col.min() >= 0  # NaN is not
    if above and row.max() <= rows - 1 and col.max() <= cols - 1:
        return row, col, None
    valid = (row >= -0.5) & (row <= rows - 0.5) & (col >= -0.5) & (col <= cols - 0.5)
    row = np.where(valid, np.clip(row, 0, rows - 1), row.dtype.type(0))
    col = np.where(valid, np.clip(col, 0, cols - 1), col.dtype.type(0))
    return row, col, valid
