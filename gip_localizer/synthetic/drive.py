# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A synthetic drive: world, map, camera, motion and odometry from one set of parameters.

The node `synthetic_camera`, `gip simulate`, `gip demo` and the evaluation all use it.

"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.io.map_files import load_map
from gip_localizer.synthetic.motions import make_motion, VehicleMotion
from gip_localizer.synthetic.parameters import Ground, SyntheticCameraParameters
from gip_localizer.synthetic.road_shape import make_shape
from gip_localizer.synthetic.synthetic_camera import SyntheticCamera
from gip_localizer.synthetic.wheel_odometry import odometry_readings, OdometryReading
from gip_localizer.synthetic.world_changes import changed, relaid
from gip_localizer.synthetic.worlds import (
    map_of,
    map_world,
    road_world,
    tiles_world,
    World,
)

_road_world = lru_cache(maxsize=1)(road_world)  # takes seconds to make; callers only read it


@dataclass(frozen=True, eq=False)
class SyntheticFrame:
    """
    One image of a drive.

    Attributes
    ----------
    index, stamp_ns : int
        Number of the frame and its time.
    image : (height, width) uint8 or uint16
        The camera's image.
    calibration : Calibration
        The numbers of its CameraInfo.
    truth : Pose2
        T_map_base.
    extrinsics : Extrinsics
        True mounting pose of the camera in this frame (the suspension moves it).
    hidden : (height, width) bool or None
        True where a car hides the road; None without cars.

    """

    index: int
    stamp_ns: int
    image: NDArray[np.unsignedinteger]
    calibration: Calibration
    truth: Pose2
    extrinsics: Extrinsics
    hidden: NDArray[np.bool_] | None


class SyntheticDrive:
    """
    A vehicle with a camera that moves through a world.

    Parameters
    ----------
    parameters : SyntheticCameraParameters
        All settings of world, camera, motion and disturbances.
    start_ns : int
        Stamp of the first frame, nanoseconds.

    Raises
    ------
    MapError
        The world is a map file that cannot be used.
    TrajectoryError
        The trajectory is a TUM file that cannot be used.

    """

    def __init__(self, parameters: SyntheticCameraParameters, *, start_ns: int = 0) -> None:
        self.parameters = parameters
        self.start_ns = start_ns
        self.world = make_world(parameters.world)
        self.motion: VehicleMotion = make_motion(parameters.drive, self.world.lane)

    @cached_property
    def raster_map(self) -> RasterMap:
        """The map that the localizer uses: the world before its changes, in coarser cells."""
        return map_of(self.world.raster, self.parameters.world.join)

    @cached_property
    def synthetic_camera(self) -> SyntheticCamera:
        """The camera in the world as it is now, changes included."""
        ground, raster = self.parameters.world, self.world.raster
        if ground.changed > 0.0:
            raster = changed(raster, ground.changed, seed=ground.seed)
        if ground.relaid > 0.0:
            raster = relaid(raster, ground.relaid, seed=ground.seed)
        shape = make_shape(ground, raster, self.world.lane)
        return SyntheticCamera(self.parameters, raster, shape=shape)

    @property
    def camera(self) -> CameraModel:
        """The camera model with its calibrated pose."""
        return self.synthetic_camera.camera

    def stamp_ns(self, index: int) -> int:
        """Return the stamp of a frame."""
        return self.start_ns + round(index * 1e9 / self.parameters.rate)

    def truth(self, index: int) -> Pose2:
        """Return T_map_base at a frame."""
        return self.motion.pose(index / self.parameters.rate)

    def frame(self, index: int) -> SyntheticFrame:
        """Return a frame by its number; the result does not depend on earlier calls."""
        time = index / self.parameters.rate
        pose = self.motion.pose(time)
        capture = self.synthetic_camera.capture(
            pose, index, twist=self.motion.twist(time), time=time
        )
        return SyntheticFrame(
            index, self.stamp_ns(index), capture.image, self.camera.calibration, pose,
            capture.extrinsics, capture.hidden,
        )

    def frames(self, seconds: float = math.inf) -> Iterator[SyntheticFrame]:
        """Yield frames for some seconds, or until the motion ends."""
        end = min(seconds, self.motion.duration + 1e-9)
        index = 0
        while index / self.parameters.rate < end:
            yield self.frame(index)
            index += 1

    def odometry(self) -> Iterator[OdometryReading]:
        """Yield odometry from the start until the motion ends (on a loop: without end)."""
        return odometry_readings(
            self.motion, self.parameters.odometry, seed=self.parameters.seed,
            start_ns=self.start_ns,
        )

    def events(self, seconds: float = math.inf) -> Iterator[SyntheticFrame | OdometryReading]:
        """Yield frames and odometry in the order of their stamps, odometry first."""
        readings = self.odometry()
        reading = next(readings, None)
        for frame in self.frames(seconds):
            while reading is not None and reading.sample.stamp_ns <= frame.stamp_ns:
                yield reading
                reading = next(readings, None)
            yield frame


def make_world(ground: Ground) -> World:
    """Return the world that the parameters define, before its changes (raises MapError)."""
    origin = Pose2(0.0, 0.0, ground.origin_yaw)
    if ground.name == 'road':
        return _road_world(seed=ground.seed, resolution=ground.resolution, origin=origin)
    if ground.name == 'tiles':
        return tiles_world(
            seed=ground.seed, resolution=ground.resolution, origin=origin,
            side=ground.tile_side, amplitude=ground.tile_amplitude,
        )
    return map_world(load_map(ground.name))
