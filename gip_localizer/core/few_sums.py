# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Sums of products of templates and fields over few translations, by the compiled loop."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.compiled import address, c_planes, kernels


class Stack:
    """
    Templates or fields, ready for the loop.

    Parameters
    ----------
    planes : (n, rows, cols) float32
        Rows may be apart, their elements not. The loop reads what the array holds then.

    """

    def __init__(self, planes: Floats) -> None:
        self.planes = planes
        self.c_planes = c_planes(planes)


class Pairs:
    """Pairs of template and field (indices) whose products are added."""

    def __init__(self, pairs: Sequence[tuple[int, int]]) -> None:
        self._array = np.array(pairs, np.int32)
        self.count, self.address = len(pairs), address(self._array, np.int32)


def correlate_few(
    templates: Stack, fields: Stack, pairs: Pairs, start: tuple[int, int], sums: Floats
) -> None:
    """
    Write the sums of neighbouring translations.

    `sums[i, j] = Σ templates[t, r, c] fields[f, x + i + r, y + j + c]`, over pairs (t, f), rows
    and columns.

    Parameters
    ----------
    templates, fields : Stack
        What is compared.
    pairs : Pairs
        Of them.
    start : (int, int)
        The first translation: x and y.
    sums : (n_x, n_y) float32
        Contiguous.

    """
    _, rows, cols = templates.planes.shape
    _, high, wide = fields.planes.shape
    (n_x, n_y), (x, y) = sums.shape, start
    assert 0 <= x <= high - rows - n_x + 1
    assert 0 <= y <= wide - cols - n_y + 1
    kernels().correlate_few(
        templates.c_planes, fields.c_planes, pairs.address, pairs.count,
        rows, cols, x, y, n_x, n_y, address(sums, np.float32),
    )
