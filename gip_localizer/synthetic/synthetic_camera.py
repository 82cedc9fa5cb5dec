# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A rendered camera: world, suspension, traffic, weather and sensor, applied in this order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.synthetic.motions import Twist2
from gip_localizer.synthetic.parameters import Lens, SyntheticCameraParameters
from gip_localizer.synthetic.renderer import Renderer
from gip_localizer.synthetic.road_shape import RoadShape
from gip_localizer.synthetic.sensor import SensorModel
from gip_localizer.synthetic.traffic import Car, cars_hiding, draw_cars
from gip_localizer.synthetic.weather import add_glare, add_rain, add_shadows

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

_TRAFFIC_STREAM, _WEATHER_STREAM, _BUMP_STREAM, _EXPOSURE_STREAM = 7002, 7003, 7004, 7005
"""Numbers of the random streams (no unit); chosen: no other stream uses them."""
_PLATOON = 40
"""Number of frames after which the cars in view are replaced; chosen."""
_MOST_EXPOSURES = 16
"""Largest number of rendered poses per exposure; it bounds the time of a frame; chosen."""
_BUMP_HZ = (1.3, 0.9, 1.7)
"""Frequencies of pitch, roll and heave of the suspension, hertz; chosen like a passenger car's."""


@dataclass(frozen=True, eq=False)
class Capture:
    """
    An image, with the facts that a real camera does not report.

    Attributes
    ----------
    image : (height, width) uint8 or uint16
        The camera's image.
    extrinsics : Extrinsics
        True mounting pose of the camera.
    hidden : (height, width) bool or None
        True where a car hides the road; None without cars.

    """

    image: NDArray[np.unsignedinteger]
    extrinsics: Extrinsics
    hidden: Bools | None


class SyntheticCamera:
    """
    A camera above a world.

    Parameters
    ----------
    parameters : SyntheticCameraParameters
        Lens, pose, sensor and disturbances.
    world : RasterMap
        The world as it is now, changes included.
    exact : bool
        True: dense sampling, seconds per frame.
    shape : RoadShape or None
        Heights of the road; None: flat.

    """

    def __init__(
        self, parameters: SyntheticCameraParameters, world: RasterMap, *, exact: bool = False,
        shape: RoadShape | None = None,
    ) -> None:
        self.parameters = parameters
        self.camera = CameraModel.given(make_calibration(parameters.lens), parameters.camera)
        self._renderer = Renderer(world, self.camera, exact=exact, shape=shape)
        self._resolution = world.resolution
        self._platoons: dict[int, list[Car]] = {}

    @property
    def calibration(self) -> Calibration:
        """The calibration that CameraInfo carries."""
        return self.camera.calibration

    def capture(
        self, pose: Pose2, frame: int, *, twist: Twist2 | None = None, time: float = 0.0
    ) -> Capture:
        """
        Take an image; the same arguments give the same bytes.

        Parameters
        ----------
        pose : Pose2
            T_map_base in the middle of the exposure.
        frame : int
            Index of the frame: together with the seed it determines noise and weather.
        twist : Twist2, optional
            Velocity, for motion blur; at rest if not given.
        time : float
            Seconds since the start; determines the motion of the suspension.

        """
        settings = self.parameters
        extrinsics = self.extrinsics_at(time)
        scene = self._scene(pose, twist, extrinsics)
        hidden = None
        if settings.disturbance.cars > 0.0:
            held = self.camera.with_extrinsics(extrinsics)
            hidden = draw_cars(scene, held, self._traffic(frame))
        rng = np.random.default_rng([settings.seed, _WEATHER_STREAM, frame])
        if settings.disturbance.shadows > 0.0:
            add_shadows(scene, settings.disturbance.shadows, rng)
        if settings.disturbance.rain > 0.0:
            add_rain(scene, settings.disturbance.rain, rng)
        if settings.disturbance.glare > 0.0:
            add_glare(scene, settings.disturbance.glare, 0.5 + 0.3 * math.cos(pose.yaw))
        if settings.sensor.hunting > 0.0:
            rng = np.random.default_rng([settings.seed, _EXPOSURE_STREAM, frame])
            scene *= np.float32(math.exp(settings.sensor.hunting * rng.standard_normal()))
        image = self._sensor().capture(scene, settings.seed, frame)
        return Capture(image, extrinsics, hidden)

    def extrinsics_at(self, time: float) -> Extrinsics:
        """Return the mounting pose of the camera at a time (s), moved by the suspension."""
        swing = self.parameters.disturbance
        nominal = self.camera.extrinsics
        phases = np.random.default_rng([self.parameters.seed, _BUMP_STREAM]).uniform(0, 1, 3)
        waves = np.sin(2.0 * math.pi * (np.array(_BUMP_HZ) * time + phases))
        return replace(
            nominal,
            pitch=nominal.pitch + swing.pitch * float(waves[0]),
            roll=nominal.roll + swing.roll * float(waves[1]),
            z=nominal.z + swing.height * float(waves[2]),
        )

    def _scene(self, pose: Pose2, twist: Twist2 | None, extrinsics: Extrinsics) -> Floats32:
        """Return what is exposed: at once, or strip by strip as the rows are read out."""
        readout = self.parameters.sensor.readout_time
        if twist is None or readout == 0.0:
            return self._renderer.render_moving(self._exposures(pose, twist), extrinsics)
        rows = self.parameters.lens.height
        count = min(1 + int(_reach(twist) * readout / (0.5 * self._resolution)), _MOST_EXPOSURES)
        ends = np.linspace(0, rows, count + 1).astype(int)
        scene = np.zeros((rows, self.parameters.lens.width), np.float32)
        for first, end in pairwise(ends.tolist()):
            since = readout * (0.5 * (first + end - 1) / (rows - 1) - 0.5)
            moved = _driven(pose, twist, since)
            strip = self._renderer.render_moving(self._exposures(moved, twist), extrinsics)
            scene[first:end] = strip[first:end]
        return scene

    def _exposures(self, pose: Pose2, twist: Twist2 | None) -> list[Pose2]:
        """Return poses during the exposure, about half a cell apart, for smooth motion blur."""
        span = self.parameters.sensor.exposure_time
        if twist is None or span == 0.0:
            return [pose]
        count = min(1 + int(_reach(twist) * span / (0.5 * self._resolution)), _MOST_EXPOSURES)
        times = span * ((np.arange(count) + 0.5) / count - 0.5)
        return [_driven(pose, twist, t) for t in times.tolist()]

    def _traffic(self, frame: int) -> list[Car]:
        """Return the cars around the vehicle; they move slowly until they are replaced."""
        platoon, age = divmod(frame, _PLATOON)
        if platoon not in self._platoons:
            rng = np.random.default_rng([self.parameters.seed, _TRAFFIC_STREAM, platoon])
            cars = cars_hiding(self.camera, self.parameters.disturbance.cars, rng)
            self._platoons = {platoon: cars}
        drift = 0.4 * math.sin(2.0 * math.pi * age / _PLATOON)
        return [
            replace(car, pose=Pose2(car.pose.x + drift, car.pose.y, car.pose.yaw))
            for car in self._platoons[platoon]
        ]

    def _sensor(self) -> SensorModel:
        s = self.parameters.sensor
        return SensorModel(
            s.gain, s.offset, s.vignetting, s.full_well, s.read_noise, s.bits, s.gamma
        )


def _reach(twist: Twist2) -> float:
    """Return how fast (m/s, about) the road in view moves."""
    return math.hypot(twist.forward, twist.left) + 10.0 * abs(twist.turn)


def _driven(pose: Pose2, twist: Twist2, seconds: float) -> Pose2:
    """Return a pose some seconds later."""
    return pose @ Pose2(twist.forward * seconds, twist.left * seconds, twist.turn * seconds)


def make_calibration(lens: Lens) -> Calibration:
    """Return the calibration of a lens; P equals K."""
    K = np.array([
        [lens.focal, 0.0, (lens.width - 1) / 2.0],
        [0.0, lens.focal, (lens.height - 1) / 2.0],
        [0.0, 0.0, 1.0],
    ])
    if lens.model == 'equidistant':
        D = np.array([lens.k1, lens.k2, lens.k3, lens.k4])
    else:
        D = np.array([lens.k1, lens.k2, lens.p1, lens.p2, lens.k3])
    return Calibration(lens.width, lens.height, K, D, K.copy(), lens.model)
