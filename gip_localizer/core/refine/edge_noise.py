# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Noise at edges: the error of a pixel where the brightness of the road changes within it.

A pixel may sample one point of its patch of road instead of the mean (a coarse sensor, a renderer
without anti-aliasing), or be displaced by a fraction of a pixel. Its error is then proportional
to the change of the road's brightness from pixel to pixel: `σ² = κ² |∂û/∂(u, v)|² / Ã`. κ is
estimated from the residuals; it is 0 for a camera that averages well, which adds no noise.

"""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats, upper_median
from gip_localizer.core.camera.model import CameraModel

# Step (m) of the central differences of the projection (design choice: 1 mm, because rounding and
# curvature are both negligible there).
STEP = 1e-3
# Least number of cells with a strong edge for which κ is estimated, else it is 0 (design choice:
# 30, because the median of fewer is uncertain).
MIN_EDGES = 30
# Least ratio (no unit) of the edge variance for κ = 1 px to the variance of the cell, above which
# an edge is strong (design choice: 12, because weaker edges show mostly the noise of the cell).
STRONG_EDGE = 12.0
# Median of the chi-square distribution with 1 degree of freedom (no unit).
CHI_SQ_MEDIAN = 0.455
# Largest κ² (px²; design choice: 1, because no camera displaces a pixel by more than one pixel).
MAX_EDGE_SHARE = 1.0


class PixelSteps:
    """
    Displacement on the road from one pixel to the next, at given points.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera.
    points : (n, 2) float64
        Points of the road in base, metres.
    footprint : (n,) float32
        Ã of the cells there, px².

    """

    def __init__(self, camera: CameraModel, points: Floats, footprint: Floats) -> None:
        (ux, vx), (uy, vy) = (
            ((camera.project(points + shift)[0] - camera.project(points - shift)[0])
             / (2.0 * STEP)).T
            for shift in STEP * np.eye(2)
        )
        determinant = ux * vy - uy * vx
        planes = np.array([vy, -vx, -uy, ux]) / determinant  # m per pixel
        self._xu, self._yu, self._xv, self._yv = (
            np.nan_to_num(plane, posinf=0.0, neginf=0.0).astype(np.float32) for plane in planes
        )
        self._per_pixel = (1.0 / np.maximum(footprint, 1.0)).astype(np.float32)

    def changes(self, along_x: Floats, along_y: Floats) -> Floats:
        """Squared change (n,) of a map per pixel over Ã, from its slopes (n,) per metre."""
        along_u = along_x * self._xu + along_y * self._yu
        along_v = along_x * self._xv + along_y * self._yv
        return np.asarray((along_u**2 + along_v**2) * self._per_pixel)


def edge_share(residual: Floats, weights: Floats, changes: Floats) -> float:
    """
    Estimate κ² (px²) from the residuals of the cells whose edges exceed their own noise.

    Parameters
    ----------
    residual, weights : (n,) float32
        v - a S û - b and 1/variance; cells of weight 0 are ignored.
    changes : (n,) float32
        `PixelSteps.changes`, in grey levels of the view.

    """
    strong = np.flatnonzero(changes * weights > STRONG_EDGE)
    if len(strong) < MIN_EDGES:
        return 0.0
    per_pixel, variance = changes.take(strong), 1.0 / weights.take(strong)
    excess = np.maximum(residual.take(strong) ** 2 - variance, 0.0)
    return min(upper_median(excess / per_pixel) / CHI_SQ_MEDIAN, MAX_EDGE_SHARE)
