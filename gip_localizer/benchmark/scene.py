# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Searches for the benchmark: views of a road map, with the noise of their footprints."""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.gramian import gramian
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import (
    Lattice,
    make_canvas,
    make_lattice,
    map_window,
    widened,
)
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Birdseye
from gip_localizer.synthetic.localizer_parameters import CAR_VIEW
from gip_localizer.synthetic.worlds import road_world

CELL = CAR_VIEW.resolution
"""Side of a cell of map and view, metres."""
PIXEL_NOISE = 0.02
"""Standard deviation of the noise of a pixel, grey levels of [0, 1]; chosen."""
MAP_NOISE = 0.02
"""Standard deviation of the noise of a map cell, grey levels of [0, 1]; chosen."""


@dataclass(frozen=True)
class Window:
    """Half-widths of a search (m, m, rad) and its step in heading (rad)."""

    x: float
    y: float
    yaw: float
    yaw_step: float


TRACK = Window(0.5, 0.5, math.radians(2.5), math.radians(0.5))  # chosen: tracking
ACQUIRE = Window(5.0, 5.0, math.radians(15.0), math.radians(0.5))  # chosen: first fix


def camera(width: int = 1280, height: int = 720) -> CameraModel:
    """Return a camera 1.5 m above the road, pitched 15 degrees down."""
    focal = 900.0 * width / 1280.0
    K = np.array([[focal, 0.0, (width - 1) / 2], [0.0, focal, (height - 1) / 2], [0.0, 0.0, 1.0]])
    held = Extrinsics(x=0.2, z=1.5, pitch=math.radians(15.0))
    return CameraModel(Calibration(width, height, K), held)


class Scene:
    """
    A road map and the camera that sees it.

    Parameters
    ----------
    side : float
        Side of the square world, metres.
    birdseye : Birdseye
        The view.
    seed : int
        Seed of the world.

    """

    def __init__(self, side: float, birdseye: Birdseye = CAR_VIEW, seed: int = 0) -> None:
        rectifier = Rectifier(camera(), birdseye)
        self.grid = rectifier.grid
        self.footprint = rectifier.footprint
        world = road_world(seed=seed, size=(side, side), resolution=CELL)
        self.map, self.lane = world.raster, world.lane
        self.weight = gramian(self.footprint, pixel_noise=PIXEL_NOISE, map_noise=MAP_NOISE)
        # candidates turn about the middle of the weight, where heading and place are apart
        x = self.grid.points()[:, 0]
        self.pivot = float((self.weight.ravel() * x).sum() / self.weight.sum())

    def lattice(self, anchor: Pose2, window: Window) -> Lattice:
        """Return the candidates around an anchor pose."""
        return make_lattice(
            anchor, x=window.x, y=window.y, yaw=window.yaw, yaw_step=window.yaw_step,
            step=self.grid.resolution, pivot=self.pivot,
        )

    def place(self, rng: np.random.Generator) -> Pose2:
        """Return a pose on the lane."""
        station = float(rng.uniform(0.0, self.lane.length))
        x, y = self.lane.position(np.array([station]))[0]
        heading = float(self.lane.heading(np.array([station]))[0])
        return Pose2(float(x), float(y), heading)

    def level(
        self, rng: np.random.Generator, window: Window, *, noise: float = 1.0
    ) -> tuple[Level, Floats]:
        """
        Return the search of a frame and the (fractional) index of the truth in it.

        The truth is a random pose in the window; `noise` multiplies the noise of pixels and map.

        """
        lattice = self.lattice(self.place(rng), window)
        index = np.array([rng.uniform(0.0, n - 1.0) for n in lattice.shape])
        values = self.view(lattice.pose(index), rng, noise)
        canvas = make_canvas(self.grid, lattice)
        cells, known = map_window(self.map, widened(canvas, lattice), lattice.anchor)
        return Level(
            self.grid, values, self.weight, lattice, canvas, cells * known, known
        ), index

    def view(self, pose: Pose2, rng: np.random.Generator, noise: float = 1.0) -> Floats:
        """Return the view at a pose, with noise of variance 1 / weight."""
        values = self.map.sample(pose.transform(self.grid.points()))[0].reshape(self.grid.shape)
        seen = self.weight > 0.0
        sigma = np.zeros(self.grid.shape, np.float32)
        sigma[seen] = noise / np.sqrt(self.weight[seen])
        drawn = rng.standard_normal(self.grid.shape, np.float32)
        return np.where(seen, values + sigma * drawn, 0.0).astype(np.float32)


def known_map(scene: Scene, side: float) -> RasterMap:
    """Return the lower left square of the scene's map."""
    n = round(side / CELL)
    return RasterMap(np.ascontiguousarray(scene.map.grey[-n:, :n]), CELL, scene.map.origin)
