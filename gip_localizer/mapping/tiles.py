# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Sums over the cells of a map that grows with the drive, in tiles that are made when needed.

Cells are numbered from the origin of the map frame: column i covers x from i·r to (i + 1)·r and
row j covers y from j·r to (j + 1)·r, where r is the side of a cell.

"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gip_localizer.errors import MapError

TILE = 128
"""Cells along a side of a tile; chosen."""
MOST_CELLS = 2**25
"""Largest number of cells of a map (290 x 290 m at 5 cm); it bounds the memory; chosen."""


class Box(NamedTuple):
    """A rectangle of cells: first row, first column, number of rows and of columns."""

    row: int
    col: int
    rows: int
    cols: int


class TiledSums:
    """
    Several kinds of sums for every cell.

    Parameters
    ----------
    kinds : int
        Number of sums per cell.

    """

    def __init__(self, kinds: int) -> None:
        self._kinds = kinds
        self._tiles: dict[tuple[int, int], NDArray[np.float64]] = {}

    def window(self, box: Box) -> NDArray[np.float64]:
        """Return the sums (kinds, rows, cols) in a box; 0 where nothing was added."""
        sums = np.zeros((self._kinds, box.rows, box.cols))
        for key, inside, outside in _pieces(box):
            if key in self._tiles:
                sums[(slice(None), *outside)] = self._tiles[key][(slice(None), *inside)]
        return sums

    def add(self, box: Box, sums: NDArray[np.float64]) -> None:
        """
        Add sums (kinds, rows, cols) in a box.

        Raises
        ------
        MapError
            The map would become too large for the memory; nothing is added then.

        """
        pieces = [(key, inside, sums[(slice(None), *outside)])
                  for key, inside, outside in _pieces(box)]
        pieces = [piece for piece in pieces if piece[2].any()]
        self._check_size([key for key, _, _ in pieces])
        for key, inside, part in pieces:
            tile = self._tiles.setdefault(key, np.zeros((self._kinds, TILE, TILE)))
            tile[(slice(None), *inside)] += part

    def bounds(self) -> Box:
        """Return the smallest box of whole tiles that contains everything added."""
        return _around(list(self._tiles))

    def _check_size(self, keys: list[tuple[int, int]]) -> None:
        new = [key for key in keys if key not in self._tiles]
        if not new:
            return
        box = _around([*self._tiles, *new])
        if box.rows * box.cols > MOST_CELLS:
            raise MapError(
                f'the map would have {box.cols} x {box.rows} cells; expected at most '
                f'{MOST_CELLS / 1e6:.0f} million. Choose a coarser --resolution, or map parts of '
                'the drive with --start and --duration'
            )


Span = tuple[slice, slice]


def _pieces(box: Box) -> Iterator[tuple[tuple[int, int], Span, Span]]:
    """Yield for each tile under a box its key, and the common part in the tile and in the box."""
    for down, row_in, row_out in _cuts(box.row, box.rows):
        for right, col_in, col_out in _cuts(box.col, box.cols):
            yield (down, right), (row_in, col_in), (row_out, col_out)


def _cuts(first: int, count: int) -> Iterator[tuple[int, slice, slice]]:
    for tile in range(first // TILE, (first + count - 1) // TILE + 1):
        start, end = max(first, tile * TILE), min(first + count, (tile + 1) * TILE)
        yield (tile, slice(start - tile * TILE, end - tile * TILE),
               slice(start - first, end - first))


def _around(keys: list[tuple[int, int]]) -> Box:
    if not keys:
        return Box(0, 0, 0, 0)
    low, high = np.min(keys, axis=0), np.max(keys, axis=0) + 1
    row, col, rows, cols = (int(n) * TILE for n in (*low, *(high - low)))
    return Box(row, col, rows, cols)


def overlap(one: Box, other: Box) -> tuple[Span, Span]:
    """Return the common part of two boxes: rows and columns in the first and in the second."""
    spans = []
    for a, b in (((one.row, one.rows), (other.row, other.rows)),
                 ((one.col, one.cols), (other.col, other.cols))):
        start, end = max(a[0], b[0]), max(min(sum(a), sum(b)), max(a[0], b[0]))
        spans.append((slice(start - a[0], end - a[0]), slice(start - b[0], end - b[0])))
    return (spans[0][0], spans[1][0]), (spans[0][1], spans[1][1])
