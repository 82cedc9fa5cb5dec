# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Noise at edges: what a pixel errs by where the road changes within it.

A pixel that shows a point of its patch of road and not the mean (a coarse sensor, a renderer
without anti-aliasing), or stands a fraction of a pixel elsewhere, errs in proportion to how far
the road changes from pixel to pixel: `σ² = κ² |∂û/∂(u, v)|² / Ã`. How large κ is, the residuals
tell: 0 for a camera that averages well, and then nothing changes.

"""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats, median
from gip_localizer.core.camera.model import CameraModel

STEP = 1e-3  # m, of the differences
OFTEN = 30  # cells with a telling edge from which their residuals are believed
TELLING = 12.0  # variance of an edge, κ one pixel, over the cell's own
CHI_SQ_MEDIAN = 0.455  # of the chi-square distribution with 1 degree of freedom
MOST_SHARE = 1.0  # px²


class PixelSteps:
    """
    How far the road moves from pixel to pixel, at some points.

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
        turned = ux * vy - uy * vx
        planes = (vy / turned, -vx / turned, -uy / turned, ux / turned)  # m per pixel
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
    Tell κ², px², from the residuals of the cells whose edges stand out of their own noise.

    Parameters
    ----------
    residual, weights : (n,) float32
        v - a S û - b and 1/variance; 0: not looked at.
    changes : (n,) float32
        `PixelSteps.changes`, in grey levels of the view.

    """
    telling = np.flatnonzero(changes * weights > TELLING)
    if len(telling) < OFTEN:
        return 0.0
    told, variance = changes.take(telling), 1.0 / weights.take(telling)
    beyond = np.maximum(residual.take(telling) ** 2 - variance, 0.0)
    return min(median(beyond / told) / CHI_SQ_MEDIAN, MOST_SHARE)
