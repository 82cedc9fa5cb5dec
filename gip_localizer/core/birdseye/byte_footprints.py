# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Means over footprints of 8-bit images, by the compiled loop.

A pixel's share of a cell is a whole number of parts of a pixel, so that sums of bytes times parts
are exact. Pixels side by side are read as blocks; those of a block that are not on its cell have
no part in it.

"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Bools, Floats, Grey, Ints, WHITE
from gip_localizer.core.kernels.library import BLOCK, footprint_means


class ByteFootprints:
    """
    Footprints as blocks of pixels, cells with equally many blocks after each other.

    Parameters
    ----------
    overlap : (cells, rows * width) sparse float32
        Share of each pixel on each cell, whole numbers of parts; indices sorted.
    width : int
        Pixels in a row of the image, at least `BLOCK`.
    parts : int
        That a pixel is divided into, at most 64.

    """

    def __init__(self, overlap: sparse.csr_matrix, width: int, parts: int) -> None:
        cells = overlap.shape[0]
        cell = np.repeat(np.arange(cells), np.diff(overlap.indptr))
        row, col = np.divmod(overlap.indices.astype(np.int64), width)
        begins, start = _blocks(cell, row, col, width)
        block = np.cumsum(begins) - 1
        weights = np.zeros((len(start), BLOCK), np.uint8)
        weights[block, col - start[block]] = np.round(parts * overlap.data)

        count = np.bincount(cell[begins], minlength=cells)
        ranked = np.argsort(count, kind='stable')
        rank = np.empty(cells, np.int64)
        rank[ranked] = np.arange(cells)
        order = np.argsort(rank[cell[begins]], kind='stable')
        blocks_per_cell, cells_of_group = np.unique(count, return_counts=True)
        white = parts * WHITE[np.dtype(np.uint8)] * np.asarray(overlap.sum(axis=1), float).ravel()
        factors = np.divide(1.0, white, out=np.zeros(cells), where=white > 0.0)
        self._count = cells
        self._row, self._col = row[begins][order], start[order]
        self._starts = 0, np.empty(0, np.int32)  # for how many bytes from row to row
        self._groups = cells_of_group.astype(np.int32), blocks_per_cell.astype(np.int32)
        self._weights = weights[order]
        self._ranked = ranked.astype(np.int32)
        self._factors = factors[ranked].astype(np.float32)

    def of(self, image: Grey) -> Floats:
        """
        Return the means (cells,) float32 of an image (rows, width) uint8; 0 without pixels.

        The image need not be contiguous; means are in [0, 1].

        """
        if image.strides[1] != 1 or image.strides[0] <= 0:
            image = np.ascontiguousarray(image)
        step = image.strides[0]
        if step != self._starts[0]:
            self._starts = step, (self._row * step + self._col).astype(np.int32)
        means = np.empty(self._count, np.float32)
        footprint_means(image, self._starts[1], self._weights, self._groups, self._ranked,
                        self._factors, means)
        return means


def _blocks(cell: Ints, row: Ints, col: Ints, width: int) -> tuple[Bools, Ints]:
    """
    Divide pixels, in the order of cells, rows and columns, into blocks inside one row.

    Returns
    -------
    begins : (n,) bool
        The pixel is the first of a block.
    start : (blocks,) int
        Column of each block's first place.

    """
    begins = np.ones(len(cell), bool)
    begins[1:] = (np.diff(cell) != 0) | (np.diff(row) != 0)
    runs = np.flatnonzero(begins)
    offset = col - np.repeat(col[runs], np.diff(runs, append=len(col)))
    step = offset // BLOCK
    begins[1:] |= np.diff(step) != 0
    start = (col - offset + step * BLOCK)[begins]
    return begins, np.minimum(start, width - BLOCK)
