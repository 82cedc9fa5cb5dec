# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Worlds to drive in: the painted tiles, the road, or any map; and the map a vehicle would carry.

A world is finer than the localizer's map: `map_of` averages its cells by area.

"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import scaled
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.synthetic.paths import Path, rectangle_loop
from gip_localizer.synthetic.world_road import road
from gip_localizer.synthetic.world_tiles import tiles

Floats = NDArray[np.float64]

GRID_FRAME = Pose2(0.0, 0.0, 0.0)
"""The origin of a world whose map frame is its grid's."""
NAMES = ('road', 'tiles')
"""Worlds that are made; every other world is a map file."""


@dataclass(frozen=True, eq=False)
class World:
    """
    A place to drive.

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
    """Return the closed two-lane road; the lane to drive is its right one."""
    grey, lane = road(*size, resolution, seed=seed)
    return World(RasterMap(grey, resolution, origin), _moved(lane, origin))


def tiles_world(
    *, seed: int = 0, size: tuple[float, float] = (48.0, 36.0), resolution: float = 0.025,
    side: float = 0.2, amplitude: float = 0.25, origin: Pose2 = GRID_FRAME,
) -> World:
    """Return the paper's painted squares, and a rounded rectangle to drive over them."""
    grey = tiles(*size, resolution, seed=seed, side=side, amplitude=amplitude)
    return map_world(RasterMap(grey, resolution, origin))


def map_world(raster: RasterMap) -> World:
    """Return any map as a world; the lane is a rounded rectangle well inside it."""
    width, height = raster.size_m
    margin = 0.25 * min(width, height)
    low, high = np.array([margin, margin]), np.array([width - margin, height - margin])
    loop = rectangle_loop(low, high, 0.45 * margin)
    return World(raster, _moved(loop, raster.origin))


def map_of(world: RasterMap, factor: int) -> RasterMap:
    """
    Return the map with cells `factor` times as large, each the mean of the world's.

    Rows at the top and columns at the right that fill no whole cell are left out; a cell holds
    data where all of its parts do.

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
    grey = scaled(world.grey[part])
    mean = np.asarray(cv2.resize(grey, (cols, rows), interpolation=cv2.INTER_AREA), np.float32)
    valid = None
    if world.valid is not None:
        blocks = world.valid[part].reshape(rows, factor, cols, factor)
        valid = np.asarray(blocks.all(axis=(1, 3)))
    return RasterMap(mean, world.resolution * factor, world.origin, valid)


def _moved(path: Path, origin: Pose2) -> Path:
    """Return a path of the grid frame in the map frame."""
    return Path(np.asarray(origin.transform(path.position(path.stations)), float),
                closed=path.closed)
