# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Solutions and inverses of symmetric systems of equations that may be singular."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats

# Least eigenvalue (no unit) of an information matrix scaled to a unit diagonal (design choice:
# 1e-9, because smaller ones are rounding errors of float32 sums).
SINGULAR = 1e-9
# Least diagonal element (unit of the matrix) for this scaling (design choice: 1e-15, because at a
# wrong place elements may be negative).
LEAST_DIAGONAL = 1e-15


def solved(matrix: Floats, right: Floats) -> Floats:
    """Return the solution of symmetric systems (..., p, p); the shortest one if singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, right))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(matrix, hermitian=True) @ right)


def inverse(matrix: Floats) -> Floats:
    """Return the inverse of a symmetric matrix (p, p); its pseudo-inverse if it is singular."""
    return solved(matrix, np.eye(len(matrix)))


def positive_inverse(matrix: Floats) -> Floats:
    """Return the inverse of a symmetric matrix (p, p) whose least eigenvalues are raised."""
    root = inverse_root(matrix)
    return np.asarray(root @ root.T)


def inverse_root(matrix: Floats) -> Floats:
    """Return R (p, p) of `R Rᵀ`, the inverse of a matrix; eigenvalues are at least `SINGULAR`."""
    unit = 1.0 / np.sqrt(np.maximum(np.diag(matrix), LEAST_DIAGONAL))
    values, vectors = np.linalg.eigh(matrix * np.outer(unit, unit))
    return np.asarray(unit[:, None] * (vectors / np.sqrt(np.maximum(values, SINGULAR))))
