# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A view's planes turned onto the canvas, bilinear.

By little, as when following, the compiled loop reads neighbours at once; by more, and without it,
OpenCV turns.

"""

from __future__ import annotations

import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.kernels.binding import AVAILABLE, PlaneArray
from gip_localizer.core.kernels.library import MARGIN, MOST_SLOPE, turn_little


class Templates:
    """
    Planes that are turned together, by several yaws.

    Parameters
    ----------
    count : int
        Of planes.
    shape : (int, int)
        Their rows and columns.

    Attributes
    ----------
    planes : (count, rows, cols) float32
        To be filled; 0 beyond them.
    c_planes : PlaneArray
        The same for the compiled loops.

    """

    def __init__(self, count: int, shape: tuple[int, int]) -> None:
        rows, cols = shape
        padded = np.empty((count, rows + 2 * MARGIN, cols + 2 * MARGIN), np.float32)
        padded[:, :MARGIN] = padded[:, -MARGIN:] = 0.0
        padded[:, :, :MARGIN] = padded[:, :, -MARGIN:] = 0.0
        self.planes = padded[:, MARGIN:-MARGIN, MARGIN:-MARGIN]
        self.c_planes = PlaneArray(self.planes)

    def turn_into(self, out: Floats, affine: Floats) -> None:
        """Turn by `turn_affine` into (count, rows, cols) float32, which may be part of another."""
        if AVAILABLE and is_little(affine):
            turn_little(self.c_planes, affine, out)
            return
        for plane, turned in zip(self.planes, out, strict=True):
            cv2.warpAffine(
                plane, affine, (out.shape[2], out.shape[1]), dst=turned,
                flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT,
            )

    def turned(self, out: Floats, affine: Floats, count: int) -> list[float]:
        """Turn as `turn_into` does; return the sums of the first `count` turned planes."""
        self.turn_into(out, affine)
        return [cv2.sumElems(plane)[0] for plane in out[:count]]


def is_little(affine: Floats) -> bool:
    """Whether the compiled loop can turn by this angle."""
    return bool(abs(affine[1, 0]) <= MOST_SLOPE and affine[0, 0] > 0.0)


def turn_affine(grid: Grid, canvas: Grid, yaw: float, pivot: float) -> Floats:
    """Map (2, 3) from columns and rows of the canvas to those of the view."""
    c, s, step = math.cos(yaw), math.sin(yaw), grid.resolution
    # canvas cell → anchor metres → base metres → view cell, all affine
    x0, y0 = canvas.far - 0.5 * step - pivot, canvas.left - 0.5 * step
    row0 = (grid.far - pivot - (c * x0 + s * y0)) / step - 0.5
    col0 = (grid.left - (-s * x0 + c * y0)) / step - 0.5
    return np.array([[c, -s, col0], [s, c, row0]])
