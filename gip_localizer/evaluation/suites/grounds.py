# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Changes of a generated world before mapping: poor, repeated or featureless ground."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import Pose2
from gip_localizer.synthetic.paths import Path
from gip_localizer.synthetic.worlds import World

PAINT = 0.6
"""Reflectance, in [0, 1], above which the ground is paint; between that of asphalt and paint."""
POOR_BLUR_M = 1.0
"""Standard deviation of the Gaussian that smooths unpainted ground, metres; chosen."""
PERIOD_M = 0.6
"""Period of repeated ground, metres; chosen: the search window then holds several equal places."""
LANE_SIZE_M = (80.0, 14.0)
"""Length and width of the world with a straight lane, metres; chosen."""
LANE_HALF_M, LINE_M = 1.75, 0.12
"""Half-width of the lane and width of its lines, metres: those of the synthetic road."""
ASPHALT, LINE = 0.3, 0.78
"""Reflectances of asphalt and line, in [0, 1]: those of the synthetic road."""
NOISE_PATCH_M = 0.1
"""Standard deviation of the Gaussian that correlates part of a map's errors, metres; chosen."""


def poor(world: World) -> World:
    """Return the world with paint on asphalt without texture: no grain, cracks or patches."""
    raster = world.raster
    grey = on_unit_scale(raster.grey)
    painted = cv2.dilate((grey > PAINT).astype(np.float32), np.ones((3, 3)))
    bare = np.float32(1.0) - painted
    sigma = POOR_BLUR_M / raster.resolution
    smooth = cv2.GaussianBlur(grey * bare, (0, 0), sigma)
    smooth /= np.maximum(cv2.GaussianBlur(bare, (0, 0), sigma), 1e-3)
    return _regrounded(world, np.where(painted > 0.0, grey, smooth))


def repeated_ground(world: World) -> World:
    """Return the world whose ground repeats that of its upper left corner."""
    raster = world.raster
    side = round(PERIOD_M / raster.resolution)
    rows, cols = raster.grey.shape
    tiled = np.tile(raster.grey[:side, :side], (rows // side + 1, cols // side + 1))
    return _regrounded(world, tiled[:rows, :cols])


def lane(world: World) -> World:
    """Return a straight lane between two solid lines, without any other feature."""
    width, height = LANE_SIZE_M
    resolution = world.raster.resolution
    grey = np.full((round(height / resolution), round(width / resolution)), ASPHALT, np.float32)
    across = (np.arange(len(grey)) + 0.5) * resolution - 0.5 * height
    grey[np.abs(np.abs(across) - LANE_HALF_M) < 0.5 * LINE_M] = LINE
    ends = np.array([[10.0, 0.5 * height], [0.5 * width, 0.5 * height],
                     [width - 30.0, 0.5 * height]])
    return World(RasterMap(grey, resolution, Pose2(0.0, 0.0, 0.0)), Path(ends, closed=False))


def _regrounded(world: World, grey: Floats) -> World:
    raster = replace(world.raster, grey=np.ascontiguousarray(grey, np.float32))
    return replace(world, raster=raster)


GROUNDS: dict[str, Callable[[World], World]] = {
    'as made': lambda world: world, 'poor': poor, 'repeated': repeated_ground, 'lane': lane,
}
"""Changes by the names that a `Setup` uses."""


def noisy_map(raster: RasterMap, sigma: float, seed: int) -> RasterMap:
    """Return a map with white noise, and with errors that are equal over small patches."""
    rng = np.random.default_rng([seed, 4711])
    grey = on_unit_scale(raster.grey)
    white, patchy = rng.normal(0.0, sigma, (2, *grey.shape))
    patchy = cv2.GaussianBlur(patchy, (0, 0), NOISE_PATCH_M / raster.resolution)
    patchy *= sigma / max(float(patchy.std()), 1e-12)
    off = np.clip(grey + 0.9 * white + 0.4 * patchy, 0.0, 1.0).astype(np.float32)
    return replace(raster, grey=off)
