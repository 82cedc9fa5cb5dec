# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The candidates of a search, and the part of the map and the turned views that they compare.

Yaws turn the view, whose sums G and G v are small, and not the map, so that what is computed of
the map serves all yaws.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.template_rotation import turn_affine
from gip_localizer.core.pose import Pose2

Index = tuple[int, int, int]
"""Of yaw, x and y in a lattice."""


@dataclass(frozen=True)
class Lattice:
    """
    The candidates: offsets from an anchor pose, in the anchor's own axes.

    Attributes
    ----------
    anchor : Pose2
        Prior pose of base in map.
    step : float
        Step in x and y, metres.
    half : (int, int)
        Steps ahead (= behind) and left (= right).
    yaws : (n,) float64
        Offsets in heading, radians.
    pivot : float
        The point, metres ahead of base, about which candidates turn; the offsets in x and y are
        that point's. A pivot inside the view keeps the map window small.

    """

    anchor: Pose2
    step: float
    half: tuple[int, int]
    yaws: Floats
    pivot: float = 0.0

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of yaws, of x offsets (first is farthest ahead), of y offsets (left first)."""
        return len(self.yaws), 2 * self.half[0] + 1, 2 * self.half[1] + 1

    def offset(self, index: Floats) -> Pose2:
        """Pose of a (fractional) index (yaw, x, y) relative to the anchor."""
        yaw = float(np.interp(index[0], np.arange(len(self.yaws)), self.yaws))
        return Pose2(
            (self.half[0] - float(index[1])) * self.step + self.pivot * (1.0 - math.cos(yaw)),
            (self.half[1] - float(index[2])) * self.step - self.pivot * math.sin(yaw),
            yaw,
        )

    def pose(self, index: Floats) -> Pose2:
        """Pose of base in map of a (fractional) index (yaw, x, y)."""
        return self.anchor @ self.offset(index)


def make_lattice(
    anchor: Pose2, *, x: float, y: float, yaw: float, yaw_step: float, step: float,
    pivot: float = 0.0,
) -> Lattice:
    """Return the lattice that covers ±x, ±y (m) and ±yaw (rad) about the anchor."""
    count = math.ceil(yaw / yaw_step - 1e-9)
    half = (math.ceil(x / step - 1e-9), math.ceil(y / step - 1e-9))
    return Lattice(anchor, step, half, np.arange(-count, count + 1) * yaw_step, pivot)


def make_canvas(grid: Grid, lattice: Lattice) -> Grid:
    """Return the cells, in the anchor's axes, that the view covers at any of the yaws."""
    x, y = (grid.outline() - [lattice.pivot, 0.0]).T
    yaws = _extreme_yaws(lattice.yaws)[:, None]
    turned_x = np.cos(yaws) * x - np.sin(yaws) * y + lattice.pivot
    turned_y = np.sin(yaws) * x + np.cos(yaws) * y
    steps = grid.resolution
    far = grid.far + math.ceil((turned_x.max() - grid.far) / steps - 1e-6) * steps
    left = grid.left + math.ceil((turned_y.max() - grid.left) / steps - 1e-6) * steps
    rows = math.ceil((far - turned_x.min()) / steps - 1e-6)
    cols = math.ceil((left - turned_y.min()) / steps - 1e-6)
    return Grid(far, left, rows, cols, steps)


def _extreme_yaws(yaws: Floats) -> Floats:
    """Yaws whose union of views holds every view in between (quarter turns included)."""
    if len(yaws) == 1:
        return yaws
    return np.linspace(yaws[0], yaws[-1], 2 + int((yaws[-1] - yaws[0]) / 0.02))


def widened(canvas: Grid, lattice: Lattice) -> Grid:
    """Return the canvas and what the translations add on every side."""
    return Grid(
        canvas.far + lattice.half[0] * canvas.resolution,
        canvas.left + lattice.half[1] * canvas.resolution,
        canvas.rows + 2 * lattice.half[0],
        canvas.cols + 2 * lattice.half[1],
        canvas.resolution,
    )


def map_window(raster_map: RasterMap, grid: Grid, anchor: Pose2) -> tuple[Floats, Floats]:
    """Map values and known (0 or 1), (rows, cols) float32, on a grid at the anchor."""
    values, valid = raster_map.sample(anchor.transform(grid.points()))
    return values.reshape(grid.shape), valid.reshape(grid.shape).astype(np.float32)


def rotated(
    templates: Floats, grid: Grid, canvas: Grid, yaw: float, *, pivot: float = 0.0
) -> Floats:
    """Templates (rows, cols, n) of a view turned by a yaw, on the canvas (bilinear)."""
    return np.asarray(cv2.warpAffine(
        templates, turn_affine(grid, canvas, yaw, pivot), (canvas.cols, canvas.rows),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT,
    ), np.float32)


