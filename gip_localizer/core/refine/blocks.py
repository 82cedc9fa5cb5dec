# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of road: groups of neighbouring cells whose sums are computed together."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Ints, stacked


class Blocks:
    """
    Cells grouped into blocks of road, and these blocks grouped into larger blocks.

    Parameters
    ----------
    x, y : (n,) float32
        Positions of the cells, metres.
    sides : (float, float)
        Side lengths of a block, metres ahead and left.
    per_larger : (int, int)
        Number of blocks per larger block, ahead and left.

    Attributes
    ----------
    order : (n,) int
        Indices of the cells, sorted by block; all methods expect cells in this order.

    """

    def __init__(
        self, x: Floats, y: Floats, sides: tuple[float, float], per_larger: tuple[int, int]
    ) -> None:
        ahead = np.floor((x - x.min()) / sides[0]).astype(int)
        left = np.floor((y - y.min()) / sides[1]).astype(int)
        larger = _numbered(ahead // per_larger[0], left // per_larger[1])
        block = larger * (per_larger[0] * per_larger[1]) + (ahead % per_larger[0]) * per_larger[1]
        block += left % per_larger[1]
        self.order: Ints = np.argsort(block, kind='stable')
        sorted_blocks = block[self.order]
        starts = np.flatnonzero(np.diff(sorted_blocks, prepend=-1))
        self._runs = _runs(np.diff(starts, append=len(block)))
        whole = larger[self.order]
        self._larger_starts = np.flatnonzero(np.diff(whole, prepend=-1))
        self._larger_counts = np.diff(self._larger_starts, append=len(whole))
        self._larger_runs = _runs(self._larger_counts)

    def products(self, left: Floats, right: Floats) -> Floats:
        """Return products (blocks, k, m) float64 of left (k, n) and right (m, n) in each block."""
        return _products(self._runs, left, right)

    def larger_products(self, left: Floats, right: Floats) -> Floats:
        """Return products (larger blocks, k, m) float64 in each larger block."""
        return _products(self._larger_runs, left, right)

    def larger_sums(self, values: Floats) -> Floats:
        """Return sums (larger blocks,) of values (n,)."""
        return np.add.reduceat(values, self._larger_starts)

    def over_larger(self, values: Floats | Bools) -> Floats:
        """Return for every cell (n,) float32 the value of its larger block."""
        return np.repeat(values.astype(np.float32), self._larger_counts)


Runs = list[tuple[slice, int]]
"""Runs of consecutive blocks of equal size: slice of the cells, number of blocks."""


def _products(runs: Runs, left: Floats, right: Floats) -> Floats:
    return np.concatenate([
        stacked(left[:, cells], count) @ stacked(right[:, cells], count).transpose(0, 2, 1)
        for cells, count in runs
    ]).astype(np.float64)


def _runs(sizes: Ints) -> Runs:
    firsts = np.flatnonzero(np.diff(sizes, prepend=-1))
    counts = np.diff(firsts, append=len(sizes))
    ends = np.cumsum(sizes[firsts] * counts).tolist()
    cells = [slice(a, b) for a, b in zip([0, *ends], ends, strict=False)]
    return list(zip(cells, counts.tolist(), strict=True))


def whole_blocks(side: float, wanted: float) -> int:
    """Return how many blocks of a side fit best into a larger side `wanted`, at least 1."""
    return max(math.floor(wanted / side + 0.5), 1)


def _numbered(ahead: Ints, left: Ints) -> Ints:
    return ahead * (int(left.max()) + 1) + left
