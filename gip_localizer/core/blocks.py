# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks of road: neighbouring cells whose sums are looked at together."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Floats, Ints


class Blocks:
    """
    Cells divided into blocks of road, and those joined into larger ones.

    Parameters
    ----------
    x, y : (n,) float32
        Where the cells are, metres.
    sides : (float, float)
        Of a block, metres ahead and left.
    joined : (int, int)
        Blocks per larger one, ahead and left.

    Attributes
    ----------
    order : (n,) int
        The cells block by block; all methods take cells in this order.

    """

    def __init__(
        self, x: Floats, y: Floats, sides: tuple[float, float], joined: tuple[int, int]
    ) -> None:
        ahead = np.floor((x - x.min()) / sides[0]).astype(int)
        left = np.floor((y - y.min()) / sides[1]).astype(int)
        larger = _numbered(ahead // joined[0], left // joined[1])
        block = larger * (joined[0] * joined[1]) + (ahead % joined[0]) * joined[1]
        block += left % joined[1]
        self.order: Ints = np.argsort(block, kind='stable')
        sorted_blocks = block[self.order]
        self._starts = np.flatnonzero(np.diff(sorted_blocks, prepend=-1))
        ends = [*self._starts[1:].tolist(), len(block)]
        self._parts = [slice(a, b) for a, b in zip(self._starts.tolist(), ends, strict=True)]
        whole = larger[self.order]
        self._larger_starts = np.flatnonzero(np.diff(whole, prepend=-1))
        self._larger_counts = np.diff(np.append(self._larger_starts, len(whole)))

    def sums(self, rows: Floats) -> Floats:
        """Sums (k, blocks) float64 of rows (k, n) over each block."""
        return np.add.reduceat(rows, self._starts, axis=1).astype(np.float64)

    def products(self, left: Floats, right: Floats) -> Floats:
        """Products (blocks, k, k) float64 of each block's columns of left and right (k, n)."""
        return np.stack([left[:, part] @ right[:, part].T for part in self._parts], dtype=float)

    def larger_sums(self, rows: Floats) -> Floats:
        """Sums (k, larger blocks) float64 of rows (k, n) over each larger block."""
        return np.add.reduceat(rows, self._larger_starts, axis=1).astype(np.float64)

    def over_larger(self, values: Floats) -> Floats:
        """Give every cell (n,) float32 the value of its larger block."""
        return np.repeat(values.astype(np.float32), self._larger_counts)


def whole_blocks(side: float, wanted: float) -> int:
    """Return how many blocks of a side make one of about the side that is wanted, at least 1."""
    return max(math.floor(wanted / side + 0.5), 1)


def _numbered(ahead: Ints, left: Ints) -> Ints:
    return ahead * (int(left.max()) + 1) + left
