# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Every setting of the synthetic camera, once: default, unit, bounds and meaning.

Defaults are chosen to resemble a passenger car with a machine-vision camera.

"""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.errors import ParameterError
from gip_localizer.parameters import Camera
from gip_localizer.parameters.integration import Frames
from gip_localizer.parameters.spec import group, ParameterGroup
from gip_localizer.parameters.spec import parameter as p


@dataclass(frozen=True)
class Ground:
    """The world that is rendered, and the map that is made from it."""

    name: str = p('road', 'World: road, tiles, or the YAML file of a map.', read_only=True)
    seed: int = p(0, 'Seed of the world.', low=0, high=2**31 - 1, read_only=True)
    resolution: float = p(0.025, 'Cell size of the generated worlds.', unit='m', low=0.002,
                          high=1.0, read_only=True)
    join: int = p(2, 'Number of world cells along each side of one map cell.', low=1,
                  high=100, read_only=True)
    origin_yaw: float = p(0.0, 'Yaw of the grid of generated worlds in the map frame.',
                          unit='rad', low=-3.2, high=3.2, read_only=True)
    tile_side: float = p(0.3, 'Side of a painted square.', unit='m', low=0.01, high=10.0,
                         read_only=True)
    tile_amplitude: float = p(0.25, 'Contrast: a square is mean grey plus or minus this.', low=0.0,
                              high=0.45, read_only=True)
    changed: float = p(0.0, 'Fraction of the area that changed after mapping.', low=0.0,
                       high=0.9, read_only=True)
    relaid: float = p(0.0, 'Share of the area with new asphalt since, its paint kept.', low=0.0,
                      high=0.9, read_only=True)
    crown: float = p(0.0, 'Cross slope to both sides of the centre line.', unit='rad', low=0.0,
                     high=0.1, read_only=True)
    grade: float = p(0.0, 'Change of the slope along the road over 30 m.', unit='rad', low=0.0,
                     high=0.2, read_only=True)
    bank: float = p(0.0, 'Cross slope of the curves.', unit='rad', low=0.0, high=0.15,
                    read_only=True)


@dataclass(frozen=True)
class Lens:
    """Image size and lens; the principal point is the image centre."""

    width: int = p(1280, 'Image width.', unit='px', low=16, high=8192, read_only=True)
    height: int = p(720, 'Image height.', unit='px', low=16, high=8192, read_only=True)
    focal: float = p(900.0, 'Focal length.', unit='px', low=5.0, high=50000.0, read_only=True)
    model: str = p('plumb_bob', 'Distortion model.', choices=('plumb_bob', 'equidistant'),
                   read_only=True)
    k1: float = p(0.0, 'Distortion.', low=-2.0, high=2.0, read_only=True)
    k2: float = p(0.0, 'Distortion.', low=-2.0, high=2.0, read_only=True)
    p1: float = p(0.0, 'Distortion (plumb_bob).', low=-1.0, high=1.0, read_only=True)
    p2: float = p(0.0, 'Distortion (plumb_bob).', low=-1.0, high=1.0, read_only=True)
    k3: float = p(0.0, 'Distortion.', low=-2.0, high=2.0, read_only=True)
    k4: float = p(0.0, 'Distortion (equidistant).', low=-2.0, high=2.0, read_only=True)


@dataclass(frozen=True)
class Sensor:
    """Exposure and noise, as fractions of full scale."""

    gain: float = p(1.1, 'Exposure: full scale per unit of scene brightness.', low=0.0, high=100.0)
    offset: float = p(0.02, 'Black level.', low=-1.0, high=1.0)
    vignetting: float = p(0.2, 'Fraction of light lost in the image corners.', low=0.0, high=1.0)
    full_well: float = p(10000.0, 'Electrons at full scale; 0 disables shot noise.', low=0.0,
                         high=1e9)
    read_noise: float = p(0.004, 'Standard deviation of white noise.', low=0.0, high=10.0)
    gamma: float = p(1.0, 'Tone curve: values are raised to this power.', low=0.2, high=5.0)
    hunting: float = p(0.0, 'Exposure from frame to frame, standard deviation of its logarithm.',
                       low=0.0, high=1.0)
    readout_time: float = p(0.0, 'Time between the first and the last row (rolling shutter).',
                            unit='s', low=0.0, high=0.2)
    exposure_time: float = p(0.002, 'Time in which the image smears with the motion.', unit='s',
                             low=0.0, high=1.0)
    bits: int = p(8, 'Bits per pixel, 8 or 16.', low=8, high=16, read_only=True)


@dataclass(frozen=True)
class Drive:
    """Motion of the vehicle."""

    trajectory: str = p('loop', 'loop (along the lane), line (straight), or a TUM file.',
                        read_only=True)
    speed: float = p(5.0, 'Speed on loop and line; a TUM file has its own times.', unit='m/s',
                     low=0.0, high=100.0, read_only=True)
    start: float = p(0.0, 'Start position along the lane.', unit='m', low=0.0, high=1e6,
                     read_only=True)


@dataclass(frozen=True)
class Odometry:
    """Simulated wheel odometry and its errors."""

    rate: float = p(50.0, 'Messages per second.', unit='Hz', low=0.1, high=1000.0,
                    read_only=True)
    noise_xy: float = p(0.01, 'Random walk of the position with the distance.', unit='m/√m',
                        low=0.0, high=10.0, read_only=True)
    noise_yaw: float = p(0.001, 'Random walk of the heading with the distance.', unit='rad/√m',
                         low=0.0, high=1.0, read_only=True)
    scale_error: float = p(0.005, 'Relative error of the measured distance.', low=-0.5,
                           high=0.5, read_only=True)
    yaw_drift: float = p(0.0003, 'Constant drift of the heading with the distance.', unit='rad/m',
                         low=-1.0, high=1.0, read_only=True)


@dataclass(frozen=True)
class Disturbance:
    """Disturbances that neither map nor calibration contain."""

    pitch: float = p(0.0, 'Amplitude of unmeasured pitch (suspension).', unit='rad', low=0.0,
                     high=0.05)
    roll: float = p(0.0, 'Amplitude of unmeasured roll.', unit='rad', low=0.0, high=0.05)
    height: float = p(0.0, 'Amplitude of unmeasured height.', unit='m', low=0.0, high=0.2)
    cars: float = p(0.0, 'Fraction of the visible road that cars hide.', low=0.0, high=0.5)
    glare: float = p(0.0, 'Brightness that glare of a low sun adds.', low=0.0, high=5.0)
    shadows: float = p(0.0, 'Fraction of the light that hard shadows block.', low=0.0, high=0.95)
    rain: float = p(0.0, 'Strength of rain; 1 is a downpour.', low=0.0, high=2.0)


@dataclass(frozen=True)
class SyntheticCameraParameters(ParameterGroup):
    """All parameters of the node `synthetic_camera`."""

    seed: int = p(0, 'Seed of noise, odometry, traffic and weather.', low=0, high=2**31 - 1,
                  read_only=True)
    rate: float = p(10.0, 'Images per second.', unit='Hz', low=0.01, high=1000.0, read_only=True)
    world: Ground = group(Ground)
    frames: Frames = group(Frames)
    camera: Camera = group(Camera)
    lens: Lens = group(Lens)
    sensor: Sensor = group(Sensor)
    drive: Drive = group(Drive)
    odometry: Odometry = group(Odometry)
    disturbance: Disturbance = group(Disturbance)

    def check(self) -> None:
        """Check what a range cannot express (raises ParameterError)."""
        if self.sensor.bits not in (8, 16):
            raise ParameterError(
                f'parameter sensor.bits: got {self.sensor.bits}, expected 8 or 16'
            )


@dataclass(frozen=True)
class Publishing:
    """How frames are published."""

    transport: str = p('raw', 'Topic of the images: image (raw) or image/compressed.',
                       choices=('raw', 'compressed'), read_only=True)
    jpeg_quality: int = p(90, 'JPEG quality of compressed images.', low=1, high=100)
    wait: bool = p(False, 'Wait for subscribers of image, camera_info and odom.',
                   read_only=True)


@dataclass(frozen=True)
class CameraNodeParameters(SyntheticCameraParameters):
    """All parameters of the node `synthetic_camera`."""

    publish: Publishing = group(Publishing)
