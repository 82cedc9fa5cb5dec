# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Worlds to drive in (painted tiles, the road, or any map), and the localizer's map of a world.

A world has smaller cells than the localizer's map: `map_of` averages them by area.

"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.synthetic.paths import Path, rectangle_loop
from gip_localizer.synthetic.world_road import road
from gip_localizer.synthetic.world_tiles import tiles

Floats = NDArray[np.float64]

GRID_FRAME = Pose2(0.0, 0.0, 0.0)
"""Origin of a world whose map frame equals its grid frame."""
NAMES = ('road', 'tiles')
"""Names of the generated worlds; every other name is a map file."""


@dataclass(frozen=True, eq=False)
class World:
    """
    A ground raster and a path to drive on it.

    Attributes
    ----------
    raster : RasterMap
        Reflectance of the ground.
    lane : Path
        Closed path to drive along, in the map frame.

    """

    raster: RasterMap
    lane: Path


def road_world(
    *, seed: int = 0, size: tuple[float, float] = (60.0, 40.0), resolution: float = 0.025,
    origin: Pose2 = GRID_FRAME,
) -> World:
    """Return the closed two-lane road; the path follows its right lane."""
    grey, lane = road(*size, resolution, seed=seed)
    return World(RasterMap(grey, resolution, origin), _moved(lane, origin))


def tiles_world(
    *, seed: int = 0, size: tuple[float, float] = (48.0, 36.0), resolution: float = 0.025,
    side: float = 0.2, amplitude: float = 0.25, origin: Pose2 = GRID_FRAME,
) -> World:
    """Return the paper's painted squares; the path is a rounded rectangle over them."""
    grey = tiles(*size, resolution, seed=seed, side=side, amplitude=amplitude)
    return map_world(RasterMap(grey, resolution, origin))


def map_world(raster: RasterMap) -> World:
    """Return any map as a world; the path is a rounded rectangle, a quarter inside the edges."""
    width, height = raster.size_m
    margin = 0.25 * min(width, height)
    low, high = np.array([margin, margin]), np.array([width - margin, height - margin])
    loop = rectangle_loop(low, high, 0.45 * margin)
    return World(raster, _moved(loop, raster.origin))


def map_of(world: RasterMap, factor: int) -> RasterMap:
    """
    Return the map of a world: each cell is the mean of `factor` x `factor` cells of the world.

    Rows at the top and columns at the right that do not fill a whole cell are left out. A cell
    holds data if all of its parts do.

    Raises
    ------
    MapError
        The factor is below 1, or larger than the world.

    """
    rows, cols = (size // factor if factor > 0 else 0 for size in world.grey.shape)
    if rows == 0 or cols == 0:
        raise MapError(
            f'cannot join {factor} x {factor} cells of a map of {world.grey.shape}; '
            'expected a factor from 1 to the smaller side'
        )
    top = world.grey.shape[0] - rows * factor
    part = (slice(top, None), slice(0, cols * factor))
    grey = on_unit_scale(world.grey[part])
    mean = np.asarray(cv2.resize(grey, (cols, rows), interpolation=cv2.INTER_AREA), np.float32)
    valid = None
    if world.valid is not None:
        blocks = world.valid[part].reshape(rows, factor, cols, factor)
        valid = np.asarray(blocks.all(axis=(1, 3)))
    return RasterMap(mean, world.resolution * factor, world.origin, valid)


def _moved(path: Path, origin: Pose2) -> Path:
    """Transform a path from the grid frame to the map frame."""
    return Path(np.asarray(origin.transform(path.position(path.stations)), float),
                closed=path.closed)
