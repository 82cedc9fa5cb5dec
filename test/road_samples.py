# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A road, its map, and what cameras see from known poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Parameters
from gip_localizer.synthetic.renderer import Renderer
from gip_localizer.synthetic.sensor import SensorModel
from gip_localizer.synthetic.worlds import map_of, road_world

ORIGIN = Pose2(5.0, -3.0, 0.5)
PARAMETERS = Parameters.from_dict({
    'birdseye.near': 3.0, 'birdseye.far': 10.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.05,
})


class Road:
    """
    The world, its map with cells twice as large, and rendered frames.

    With a period (m) the ground repeats itself along both axes of the map; size: length and width
    of the world, m.

    """

    def __init__(
        self, period: float = 0.0, size: tuple[float, float] = (40.0, 30.0)
    ) -> None:
        world = road_world(seed=3, size=size, origin=ORIGIN)
        self.raster, self.lane = world.raster, world.lane
        if period:
            n, (rows, cols) = round(period / self.raster.resolution), self.raster.grey.shape
            tile = self.raster.grey[400 : 400 + n, 400 : 400 + n]
            grey = np.tile(tile, (rows // n + 1, cols // n + 1))[:rows, :cols]
            self.raster = replace(self.raster, grey=np.ascontiguousarray(grey))
        self.map = map_of(self.raster, 2)
        self._renderers: dict[object, Renderer] = {}

    def pose(self, share: float) -> Pose2:
        """The pose at a share of the lane's length, heading along it."""
        station = np.array([share * self.lane.length])
        x, y = self.lane.position(station)[0]
        return Pose2(float(x), float(y), float(self.lane.heading(station)[0]))

    def scene(self, camera: CameraModel, pose: Pose2) -> np.ndarray:
        """What the camera sees without noise, float32 in [0, 1]."""
        if camera.key() not in self._renderers:
            self._renderers[camera.key()] = Renderer(self.raster, camera)
        return self._renderers[camera.key()].render(pose)

    def frame(self, camera: CameraModel, pose: Pose2, *, noise: float = 0.01, gain: float = 1.0,
              offset: float = 0.0, bits: int = 8, seed: int = 0) -> np.ndarray:
        """An image with noise, uint8 or uint16."""
        sensor = SensorModel(gain=gain, offset=offset, read_noise=noise, bits=bits)
        return sensor.capture(self.scene(camera, pose), seed, 0)
