# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Lens models of OpenCV: distortion and its inverse, and the range in which they are unique."""

from __future__ import annotations

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats

# Radii (no unit, normalised image) at which a lens model is checked for folding (design choice: up
# to 10, 84 degrees from the optical axis, because no pinhole lens sees beyond).
FOLD_RAYS = np.linspace(0.0, 10.0, 4001)
# Largest number of iterations of the undistortion, and change (no unit, normalised image) at which
# it ends (design choice: 60 and 1e-9, because the error is then far below a thousandth of a
# pixel).
MAX_ITERATIONS, MIN_CHANGE = 60, 1e-9


def largest_radius(D: Floats, *, fisheye: bool) -> float:
    """Return the largest undistorted radius before the lens model folds back; inf without D."""
    if D.size == 0:
        return np.inf
    if fisheye:
        theta = np.linspace(0.0, 0.499 * np.pi, 2001)
        powers = theta[:, None] ** (2 * np.arange(1, 5))
        slope = 1.0 + powers @ (D * (2 * np.arange(1, 5) + 1))
        return float(np.tan(theta[_first_fold(slope)]))
    radii = FOLD_RAYS[1:]
    coefficients = np.zeros(8)
    coefficients[: min(D.size, 8)] = D[:8]
    k1, k2, _, _, k3, k4, k5, k6 = coefficients
    s = radii**2
    top, bottom = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
    distorted = np.where(bottom > 0, radii * top / np.where(bottom > 0, bottom, 1.0), -1.0)
    return float(radii[_first_fold(np.diff(distorted, prepend=0.0))])


def distorted(rays: Floats, K: Floats, D: Floats, *, fisheye: bool) -> Floats:
    """Return pixels (n, 2) of undistorted normalised rays (n, 2)."""
    if D.size == 0:
        return rays * K[[0, 1], [0, 1]] + K[:2, 2]
    if len(rays) == 0:
        return np.zeros((0, 2))
    zero = np.zeros(3)
    if fisheye:
        points = np.column_stack([rays, np.ones(len(rays))])[None]
        uv, _ = cv2.fisheye.projectPoints(points, zero, zero, K, D)
    else:
        points = np.column_stack([rays, np.ones(len(rays))])[:, None]
        uv, _ = cv2.projectPoints(points, zero, zero, K, D)
    return np.asarray(uv, float).reshape(-1, 2)


def undistorted(uv: Floats, K: Floats, D: Floats, *, fisheye: bool) -> Floats:
    """Return undistorted normalised rays (n, 2) of pixels (n, 2)."""
    if len(uv) == 0:
        return np.zeros((0, 2))
    points = np.ascontiguousarray(uv)[:, None]
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, MAX_ITERATIONS, MIN_CHANGE)
    if fisheye:
        rays = cv2.fisheye.undistortPoints(points, K, D, criteria=criteria)
    elif hasattr(cv2, 'undistortPointsIter'):
        eye = np.eye(3)
        rays = cv2.undistortPointsIter(points, K, D, eye, eye, criteria)
    else:
        rays = cv2.undistortPoints(points, K, D, criteria=criteria)
    return np.asarray(rays, float).reshape(-1, 2)


def _first_fold(slope: Floats) -> int:
    """Return the index of the last entry before the slope first stops being positive."""
    folded = np.flatnonzero(slope <= 0.0)
    return max(int(folded[0]) - 1, 0) if folded.size else len(slope) - 1
