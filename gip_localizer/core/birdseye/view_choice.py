# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The view that suits a camera: which road is compared with the map, on cells of which size.

Road is useful where the camera sees it steeply enough and where a cell covers at least one pixel.
The view is the box about the useful road. Its cells are as fine as those of the map if their
number allows it, and larger otherwise.

"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye.footprints import footprint_areas
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye

MOST_SLOPE = 8.0
"""Largest distance of useful road from the point below the camera, in camera heights; chosen: an
error of the pitch moves road by about its square times height and error, so that 0.3 degrees move
the farthest road by a third of the camera's height."""
LEAST_PIXELS = 1.0
"""Least footprint of a useful cell, square pixels; neighbours with less share their pixels, so
that a second one adds little (see the paper: the weight of a cell is its footprint)."""
MOST_CELLS = 16_000
"""Largest number of useful cells of a chosen view; chosen: half of the 32,000 of the view that the
benchmark measures, because the time of a frame is about proportional to it."""
COARSEST = 4.0
"""Largest side of a chosen cell, in sides of the map's cell; chosen: larger cells average away
what the map shows of the road; the view gets shorter instead."""
STEP = 1.25
"""Ratio of one tried side of a cell to the one before (no unit); chosen."""
LEAST_SHARE = 0.5
"""Least share of the seen road that must be useful for cells to be fine enough; chosen."""
LEAST_ROW = 0.1
"""Least number of useful samples in the first and last row, per those of the longest; chosen."""
ROUNDING = 1e-6
"""Part of a cell that is rounding of floating-point numbers; chosen."""
NO_ROAD = (
    f'the camera sees no road within {MOST_SLOPE:g} times its height; correct camera.z, '
    'camera.pitch (positive is nose down) and camera.roll'
)
SAMPLES = 49
"""Pixels along each side of the image with which the seen road is bounded; chosen."""
LATTICE = 160
"""Samples of the road along the longer side of its bounding box; chosen: 1/160 of the view."""


def choose_view(
    camera: CameraModel, map_resolution: float | None = None, resolution: float | None = None
) -> Birdseye:
    """
    Return the view that suits a camera and a map.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera and its pose in the base frame.
    map_resolution : float or None
        Side of a cell of the map, metres; None: no map is known.
    resolution : float or None
        Side of a cell of the view, metres, if it is given; None: it is chosen.

    Raises
    ------
    CalibrationError
        The camera sees no road.

    """
    road = _SeenRoad(camera)
    if resolution is not None:
        return road.view(resolution)
    finest = map_resolution or _rounded(road.pixel_side)
    for step in range(1 + math.floor(math.log(COARSEST, STEP))):
        side = _rounded(finest * STEP**step) if step else finest
        if road.count(side) <= MOST_CELLS and road.useful_share(side) >= LEAST_SHARE:
            return road.view(side)
    side = _rounded(COARSEST * finest)
    return road.view(side, road.slope_for(side))


def complete_view(
    given: Birdseye, camera: CameraModel, map_resolution: float | None = None
) -> Birdseye:
    """
    Return a view whose automatic values are chosen (`choose_view`); given values are kept.

    Raises
    ------
    CalibrationError
        The camera sees no road, or a chosen edge lies on the wrong side of a given one.

    """
    automatic = given.automatic
    if not automatic:
        return given
    chosen = choose_view(camera, map_resolution, given.resolution or None)
    view = replace(given, **{name: getattr(chosen, name) for name in automatic})
    if view.far - view.near < 2.0 * view.resolution:
        raise CalibrationError(
            f'the camera sees useful road from {chosen.near:g} to {chosen.far:g} m ahead of '
            f'base_link, and the view is given from {view.near:g} to {view.far:g} m; correct '
            'camera.*, or birdseye.near and birdseye.far (0: automatic)'
        )
    return view


def fitting_view(camera: CameraModel, map_resolution: float) -> str:
    """Return in words which view would fit a camera; why none does if it sees no road."""
    try:
        view = choose_view(camera, map_resolution)
    except CalibrationError as error:
        return str(error)
    return (
        f'birdseye.near {view.near:.3g}, far {view.far:.3g}, half_width {view.half_width:.3g} '
        'would fit (0: automatic)'
    )


def _rounded(side: float) -> float:
    """Return the side of a cell, metres, with two digits."""
    return float(f'{side:.2g}')


class _SeenRoad:
    """
    The road that a camera sees, sampled on a lattice.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera and its pose in the base frame.

    Raises
    ------
    CalibrationError
        The camera sees no road.

    """

    def __init__(self, camera: CameraModel) -> None:
        low, high = _bounding_box(camera)
        self._cell = float((high - low).max()) / LATTICE
        rows, cols = (max(math.ceil(side / self._cell), 1) for side in high - low)
        self._grid = Grid(float(high[0]), float(high[1]), rows, cols, self._cell)
        area, valid = footprint_areas(camera, self._grid)
        points = self._grid.points()
        distance = np.linalg.norm(points - camera.extrinsics.position()[:2], axis=1)
        self._slope = (distance / camera.extrinsics.z).reshape(valid.shape)
        self._density = area / self._cell**2
        self._seen = valid & (self._slope <= MOST_SLOPE)
        if not self._seen.any():
            raise CalibrationError(NO_ROAD)
        rows = np.flatnonzero(self._seen.any(axis=1))
        self._widest = 0.5 * self._cell * float(rows[-1] - rows[0] + 1)

    @property
    def pixel_side(self) -> float:
        """Side of a square as large as the road of a pixel, metres, in the median."""
        return float(1.0 / math.sqrt(np.median(self._density[self._seen])))

    def useful(self, side: float, slope: float = MOST_SLOPE) -> Bools:
        """Return True for samples (rows, cols) that are useful to cells of a side (m)."""
        pixels = self._density * side**2
        return self._seen & (pixels >= LEAST_PIXELS) & (self._slope <= slope)

    def useful_share(self, side: float) -> float:
        """Return the share of the seen road that is useful to cells of a side (m)."""
        return float(self.useful(side).sum() / self._seen.sum())

    def count(self, side: float, slope: float = MOST_SLOPE) -> int:
        """Return the number of useful cells of a side (m) in the view."""
        useful = self.useful(side, slope)
        if not useful.any():
            return 0
        low, high, half_width = self._box(useful)
        x, y = self._grid.points().T.reshape(2, *useful.shape)
        inside = useful & (x >= low) & (x <= high) & (np.abs(y) <= half_width)
        return round(float(inside.sum()) * (self._cell / side) ** 2)

    def slope_for(self, side: float) -> float:
        """Return the largest slope of which the useful cells of a side (m) are few enough."""
        slopes = np.quantile(self._slope[self._seen], np.linspace(0.0, 1.0, LATTICE))
        few = [slope for slope in slopes.tolist() if 0 < self.count(side, slope) <= MOST_CELLS]
        return few[-1] if few else MOST_SLOPE

    def view(self, side: float, slope: float = MOST_SLOPE) -> Birdseye:
        """Return the box about the useful road, rounded inwards to cells of a side (m)."""
        useful = self.useful(side, slope)
        low, high, half_width = self._box(useful if useful.any() else self._seen)
        near, far = math.ceil(low / side - ROUNDING), math.floor(high / side + ROUNDING)
        return Birdseye(
            round(near * side, 4), round(max(far, near + 2) * side, 4),
            round(max(math.floor(half_width / side), 1) * side, 4), side,
        )

    def _box(self, useful: Bools) -> tuple[float, float, float]:
        """Return nearest and farthest x and half of the width of useful samples, metres."""
        per_row = useful.sum(axis=1)
        rows = np.flatnonzero(per_row >= LEAST_ROW * per_row.max())
        high = self._grid.far - float(rows[0]) * self._cell
        low = self._grid.far - float(rows[-1] + 1) * self._cell
        cols = np.flatnonzero(useful[rows[0] : rows[-1] + 1].any(axis=0))
        left = self._grid.left - float(cols[0]) * self._cell
        right = self._grid.left - float(cols[-1] + 1) * self._cell
        return low, high, min(max(abs(left), abs(right)), self._widest)


def _bounding_box(camera: CameraModel) -> tuple[Floats, Floats]:
    """Return the least and largest (2,) x and y of the road in the image, metres."""
    u = np.linspace(-0.5, camera.width - 0.5, SAMPLES)
    v = np.linspace(-0.5, camera.height - 0.5, SAMPLES)
    pixels = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    xy, valid = camera.road_points(pixels)
    reach = MOST_SLOPE * camera.extrinsics.z
    near = np.linalg.norm(np.nan_to_num(xy, nan=np.inf) - camera.extrinsics.position()[:2], axis=1)
    seen: Floats = xy[valid & (near <= reach)]
    if not len(seen):
        raise CalibrationError(NO_ROAD)
    return seen.min(axis=0), seen.max(axis=0)
