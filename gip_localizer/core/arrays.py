# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Array types, full scales, fast medians and matrix products."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]
Grey = NDArray[Any]

WHITE = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0, np.dtype(np.float32): 1.0}
"""Full scale of grey (grey levels) by type of image: the largest integer, or 1."""
# Number of columns per matrix product (measured: longer products were slower in OpenBLAS).
PIECE = 4096


def upper_median(values: Floats) -> float:
    """Return the upper median of at least one value without NaN; NumPy's takes twice as long."""
    middle = values.size // 2
    return float(np.partition(values, middle, axis=None)[middle])


def stacked(rows: Floats, count: int) -> Floats:
    """Cut rows (k, n) into `count` equal parts, (count, k, n / count), without a copy."""
    return rows.reshape(len(rows), count, rows.shape[1] // max(count, 1)).transpose(1, 0, 2)


def product(left: Floats, right: Floats) -> Floats:
    """Return `left @ rightᵀ` (k, m) float64 of few long rows; BLAS is faster piece by piece."""
    whole = left.shape[1] // PIECE * PIECE
    pieces = stacked(left[:, :whole], whole // PIECE) @ (
        stacked(right[:, :whole], whole // PIECE).transpose(0, 2, 1)
    )
    rest = left[:, whole:] @ right[:, whole:].T
    return np.asarray(pieces.sum(axis=0, dtype=np.float64) + rest)
