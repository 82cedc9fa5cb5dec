# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The conditions of `gip evaluate`, and what is demanded of each."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from gip_localizer.parameters.spec import Value

CAR_CAMERA: dict[str, Value] = {'camera.z': 1.5, 'camera.pitch': math.radians(15.0)}
"""With the default lens: 1280x720, f = 900 px, 1.5 m up, 15 degrees down."""
STILL: dict[str, Value] = {
    'camera_motion.sigma_pitch': 0.0, 'camera_motion.sigma_roll': 0.0,
    'camera_motion.sigma_height': 0.0,
}
"""A localizer that holds the camera for fixed."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """
    What is rendered, and how it is localized.

    Attributes
    ----------
    name : str
        Short name.
    title : str
        What it is, in words.
    scenario : str
        The synthetic scenario that renders it.
    camera : dict
        Settings of the synthetic camera on top of the scenario.
    localizer : dict
        Parameters of the localizer on top of the defaults.
    ground : str
        What becomes of the world before it is mapped (`grounds.GROUNDS`).
    map_noise : float
        Standard deviation of what the map's cells are off, grey levels of [0, 1].

    """

    name: str
    title: str
    scenario: str
    camera: dict[str, Value] = field(default_factory=dict)
    localizer: dict[str, Value] = field(default_factory=dict)
    ground: str = 'as made'
    map_noise: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Condition(Setup):
    """
    One row of the suite.

    Attributes
    ----------
    rmse_xy_m, rmse_yaw_deg : float
        Largest root mean square errors.
    model_holds : bool
        True: the NEES must lie in its chi-square band; false: at most 6, since the road or the
        camera is not what the model says.

    """

    rmse_xy_m: float
    rmse_yaw_deg: float
    model_holds: bool


TILES_VIEW: dict[str, Value] = {
    'birdseye.near': 0.4, 'birdseye.far': 2.2, 'birdseye.half_width': 1.5,
    'birdseye.resolution': 0.025, **STILL,
}
"""The localizer's view of the paper's camera."""
TILES_CAMERA: dict[str, Value] = {'world.resolution': 0.05, 'world.join': 1}

CLEAR = Condition(
    name='clear', title='clear day, exposure unknown', scenario='clear',
    camera={**CAR_CAMERA, 'sensor.gain': 0.8, 'sensor.offset': 0.08},
    rmse_xy_m=0.005, rmse_yaw_deg=0.05, model_holds=True,
)
NIGHT = Condition(
    name='night', title='night: mean grey at most 25, shot noise', scenario='night',
    camera=CAR_CAMERA, rmse_xy_m=0.010, rmse_yaw_deg=0.1, model_holds=True,
)
DISTORTED = Condition(
    name='distorted', title='k1 = -0.3; roll, yaw and offset not zero', scenario='distorted',
    camera={**CAR_CAMERA, 'lens.k2': 0.0},
    localizer={'birdseye.near': 3.7, 'birdseye.far': 13.7},
    rmse_xy_m=0.005, rmse_yaw_deg=0.05, model_holds=True,
)
SHADOWS = Condition(
    name='shadows', title='hard shadows that take half of the light', scenario='shadows',
    camera=CAR_CAMERA, rmse_xy_m=0.010, rmse_yaw_deg=0.1, model_holds=False,
)
CARS = Condition(
    name='cars', title='a quarter of the view hidden by cars', scenario='occlusion',
    camera=CAR_CAMERA, rmse_xy_m=0.020, rmse_yaw_deg=0.1, model_holds=False,
)
CHANGED = Condition(
    name='changed', title='a fifth of the road changed since it was mapped', scenario='changed',
    camera=CAR_CAMERA, rmse_xy_m=0.010, rmse_yaw_deg=0.1, model_holds=False,
)
PITCH = Condition(
    name='pitch', title='hidden pitch swing of 0.7 degrees', scenario='pitch-bumps',
    camera={**CAR_CAMERA, 'disturbance.roll': 0.0, 'disturbance.height': 0.0},
    localizer={'camera_motion.sigma_pitch': math.radians(0.5)},
    rmse_xy_m=0.040, rmse_yaw_deg=0.1, model_holds=False,
)
TILES = Condition(
    name='tiles', title='the paper\'s camera over tiles, SNR -3 dB', scenario='tiles-low-snr',
    camera=TILES_CAMERA, localizer=TILES_VIEW,
    rmse_xy_m=0.005, rmse_yaw_deg=0.3, model_holds=True,
)
CONDITIONS = (CLEAR, NIGHT, DISTORTED, SHADOWS, CARS, CHANGED, PITCH, TILES)
"""Single frames, no filter; starts spread over ±0.5 m and ±3°."""
