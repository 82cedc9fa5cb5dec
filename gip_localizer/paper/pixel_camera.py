# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The paper's camera with pixels, for the renderer and the rectifier of the package.

640 pixels span the paper's horizontal field of view. The image is wider, because the rule for the
squares measures along the slant: the nearest row needs 1.06 times the width. White noise with a
standard deviation of `√N0 · f_px / f` per pixel gives every square the signal-to-noise ratio of
the paper.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Bools
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.paper.geometry import depth_of_distance, PaperCamera
from gip_localizer.paper.squares import Squares, visible_squares
from gip_localizer.parameters import Birdseye
from gip_localizer.synthetic.world_tiles import tiles

PIXELS_ACROSS = 640
"""Pixels across the paper's horizontal field of view; chosen."""
CM = 0.01
"""One centimetre, in metres."""
GREY_PER_AMPLITUDE = 0.02
"""Grey, of [0, 1], per unit of the paper's amplitude; chosen, so that a = 10 is 0.2."""
MEAN_GREY = 0.5
"""Mean grey of the tiles, of [0, 1]; chosen."""




def pixel_camera(camera: PaperCamera) -> CameraModel:
    """Return the camera above `base_link`; its image is just large enough for all squares."""
    focal = pixel_focal(camera)
    squares = visible_squares(camera)
    depth = depth_of_distance(camera, squares.distances)
    half_width = float((0.5 * camera.square * squares.counts / depth).max()) * focal
    half_height = math.tan(0.5 * math.radians(camera.fov_vertical_deg)) * focal
    width, height = (2 * math.ceil(half + 0.01) for half in (half_width, half_height))
    K = np.array([
        [focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0],
    ])
    extrinsics = Extrinsics(z=camera.height * CM, pitch=camera.theta)
    return CameraModel(Calibration(width, height, K), extrinsics)


def pixel_focal(camera: PaperCamera) -> float:
    """Return the focal length, px."""
    return 0.5 * PIXELS_ACROSS / math.tan(0.5 * math.radians(camera.fov_horizontal_deg))


def pixel_noise(camera: PaperCamera, amplitude: float) -> float:
    """
    Return the noise of a pixel that gives squares of ±0.2 grey levels the SNR of ±amplitude.

    Grey levels of [0, 1]; `√N0 · f_px / f` in units of the amplitude.

    """
    noise = math.sqrt(camera.noise_density) * pixel_focal(camera) / camera.focal_length
    return noise * 10.0 * GREY_PER_AMPLITUDE / amplitude


def square_birdseye(camera: PaperCamera) -> Birdseye:
    """Return the view whose cells are the paper's squares."""
    squares, side = visible_squares(camera), camera.square * CM
    near = float(squares.distances[0]) * CM
    far = float(squares.distances[-1]) * CM + side
    return Birdseye(near, far, 0.5 * int(squares.counts.max()) * side, side)


def paper_squares(squares: Squares, grid: Grid) -> Bools:
    """Return True for cells of `square_birdseye` that are squares of the paper, (rows, cols)."""
    column = np.abs(np.arange(grid.cols) - grid.cols // 2)
    return column[None, :] <= squares.counts[::-1, None] // 2


@dataclass(frozen=True, eq=False)
class TileWorld:
    """
    A road of random tiles with grey 0.5 ± 0.2.

    Attributes
    ----------
    fine : RasterMap
        The road that is rendered.
    coarse : RasterMap
        The map: one cell per tile.

    """

    fine: RasterMap
    coarse: RasterMap


def tile_world(camera: PaperCamera, *, size: float, resolution: float, seed: int) -> TileWorld:
    """Return a square road of `size` metres; the same seed gives the same tiles."""
    side = camera.square * CM
    amplitude = 10.0 * GREY_PER_AMPLITUDE
    fine, coarse = (
        RasterMap(
            tiles(size, size, step, seed=seed, side=side, amplitude=amplitude, mean=MEAN_GREY),
            step,
        )
        for step in (resolution, side)
    )
    return TileWorld(fine, coarse)


def aligned_pose(
    world: TileWorld, rectifier: Rectifier, margin: int, rng: np.random.Generator
) -> Pose2:
    """Return a pose whose squares coincide with tiles, `margin` tiles inside the world."""
    grid, side = rectifier.grid, world.coarse.resolution
    rows, cols = world.coarse.grey.shape
    near = round(grid.far / side) - grid.rows
    ahead = rng.integers(margin - near, cols - margin - near - grid.rows + 1)
    column = rng.integers(margin + grid.cols // 2, rows - margin - grid.cols // 2)
    return Pose2(float(ahead) * side, (float(column) + 0.5) * side, 0.0)
