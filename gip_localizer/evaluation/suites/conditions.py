# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The conditions of `gip evaluate`, and the bounds on their errors.

Settings have the units of the parameters that they set. They and the bounds (metres, degrees)
are chosen; docs/accuracy.md compares the bounds with measured errors.

"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from gip_localizer.evaluation.suites.model_errors import Miscalibration
from gip_localizer.parameters.spec import Value

CAR_CAMERA: dict[str, Value] = {'camera.z': 1.5, 'camera.pitch': math.radians(15.0)}
"""With the default lens: 1280x720, f = 900 px, 1.5 m up, 15 degrees down."""
STILL: dict[str, Value] = {
    'camera_motion.sigma_pitch': 0.0, 'camera_motion.sigma_roll': 0.0,
    'camera_motion.sigma_height': 0.0,
}
"""Localizer parameters that assume a camera without suspension motion."""


@dataclass(frozen=True, kw_only=True)
class Setup:
    """
    Settings for rendering and localizing frames.

    Attributes
    ----------
    name : str
        Short name.
    title : str
        Description of the condition.
    scenario : str
        Name of the synthetic scenario.
    camera : dict
        Settings of the synthetic camera on top of the scenario.
    localizer : dict
        Parameters of the localizer on top of the defaults.
    ground : str
        Change of the world before it is mapped (a name of `grounds.GROUNDS`).
    map_noise : float
        Standard deviation of the errors of the map's cells, grey levels of [0, 1].
    map_warp : float
        Root mean square (m) of a smooth displacement of what the map shows.
    miscalibration : Miscalibration
        Errors of the localizer's calibration.

    """

    name: str
    title: str
    scenario: str
    camera: dict[str, Value] = field(default_factory=dict)
    localizer: dict[str, Value] = field(default_factory=dict)
    ground: str = 'as made'
    map_noise: float = 0.0
    map_warp: float = 0.0
    miscalibration: Miscalibration = Miscalibration()


@dataclass(frozen=True, kw_only=True)
class Condition(Setup):
    """
    One row of the suite `conditions`.

    Attributes
    ----------
    rmse_xy_m, rmse_yaw_deg : float
        Largest root mean square errors.
    model_holds : bool
        True: the model of the localizer holds, so the NEES must lie in its chi-square band.
        False: road or camera differ from the model, so the NEES must be at most 6.

    """

    rmse_xy_m: float
    rmse_yaw_deg: float
    model_holds: bool


TILES_VIEW: dict[str, Value] = {
    'birdseye.near': 0.4, 'birdseye.far': 2.2, 'birdseye.half_width': 1.5,
    'birdseye.resolution': 0.025, **STILL,
}
"""View of the localizer for the paper's camera, metres."""
TILES_CAMERA: dict[str, Value] = {'world.resolution': 0.05, 'world.join': 1}
"""Settings of the tiles: cells of 0.05 m in world and map."""

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
"""Conditions for single frames without filter, with starts within ±0.5 m and ±3°."""
