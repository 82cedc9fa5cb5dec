# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Array types, full scales, fast medians and products; docstrings name shapes and exact types."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.floating[Any]]
Ints = NDArray[np.int_]
Bools = NDArray[np.bool_]
Grey = NDArray[Any]

WHITE = {np.dtype(np.uint8): 255.0, np.dtype(np.uint16): 65535.0, np.dtype(np.float32): 1.0}
"""Full scale of grey by type of image."""
PIECE = 4096  # columns per matrix product; larger ones were slower in OpenBLAS (measured)


def median(values: Floats) -> float:
    """Upper median of an array without NaN, at least one value; NumPy's takes twice as long."""
    middle = values.size // 2
    return float(np.partition(values, middle, axis=None)[middle])


def stacked(rows: Floats, count: int) -> Floats:
    """Cut rows (k, n) into `count` equal parts, (count, k, n / count), without a copy."""
    return rows.reshape(len(rows), count, rows.shape[1] // max(count, 1)).transpose(1, 0, 2)


def product(left: Floats, right: Floats) -> Floats:
    """Return `left @ rightᵀ` (k, m) float64 of few long rows: by pieces, faster in BLAS."""
    whole = left.shape[1] // PIECE * PIECE
    pieces = stacked(left[:, :whole], whole // PIECE) @ (
        stacked(right[:, :whole], whole // PIECE).transpose(0, 2, 1)
    )
    rest = left[:, whole:] @ right[:, whole:].T
    return np.asarray(pieces.sum(axis=0, dtype=np.float64) + rest)
