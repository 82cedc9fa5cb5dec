# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The conditions of `gip evaluate`, and what is demanded of each."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

from gip_localizer.parameter_specs import Value

CAR_CAMERA: dict[str, Value] = {'camera.z': 1.5, 'camera.pitch': math.radians(15.0)}
"""With the default lens: 1280x720, f = 900 px, 1.5 m up, 15 degrees down."""


@dataclass(frozen=True)
class Condition:
    """
    One row of the suite.

    Attributes
    ----------
    name : str
        Short name.
    title : str
        What it is, in words.
    scenario : str
        The synthetic scenario that renders it.
    rmse_xy_m, rmse_yaw_deg : float
        Largest root mean square errors.
    model_holds : bool
        True: the NEES must lie in its chi-square band; false: at most 6, since the road or the
        camera is not what the model says.
    camera : dict
        Settings of the synthetic camera on top of the scenario.
    localizer : dict
        Parameters of the localizer on top of the defaults.

    """

    name: str
    title: str
    scenario: str
    rmse_xy_m: float
    rmse_yaw_deg: float
    model_holds: bool
    camera: dict[str, Value] = field(default_factory=dict)
    localizer: dict[str, Value] = field(default_factory=dict)


CONDITIONS = (
    Condition('clear', 'clear day, exposure unknown', 'clear', 0.005, 0.05, True,
              {**CAR_CAMERA, 'sensor.gain': 0.8, 'sensor.offset': 0.08}),
    Condition('night', 'night: mean grey at most 25, shot noise', 'night', 0.010, 0.1, True,
              CAR_CAMERA),
    Condition('distorted', 'k1 = -0.3; roll, yaw and offset not zero', 'distorted', 0.005, 0.05,
              True, {**CAR_CAMERA, 'lens.k2': 0.0}, {'birdseye.near': 3.7, 'birdseye.far': 13.7}),
    Condition('cars', 'a quarter of the view hidden by cars', 'occlusion', 0.020, 0.1, False,
              CAR_CAMERA),
    Condition('changed', 'a fifth of the road changed since it was mapped', 'changed', 0.010, 0.1,
              False, CAR_CAMERA),
    Condition('pitch', 'hidden pitch swing of 0.7 degrees', 'pitch-bumps', 0.040, 0.1, False,
              {**CAR_CAMERA, 'disturbance.roll': 0.0, 'disturbance.height': 0.0},
              {'camera_motion.sigma_pitch': math.radians(0.5)}),
    Condition('tiles', 'the paper\'s camera over tiles, SNR -3 dB', 'tiles-low-snr', 0.005, 0.3,
              True, {'world.resolution': 0.05, 'world.join': 1}, {
                  'birdseye.near': 0.4, 'birdseye.far': 2.2, 'birdseye.half_width': 1.5,
                  'birdseye.resolution': 0.025, 'camera_motion.sigma_pitch': 0.0,
                  'camera_motion.sigma_roll': 0.0, 'camera_motion.sigma_height': 0.0,
              }),
)
"""Single frames, no filter; starts spread over ±0.5 m and ±3°."""
