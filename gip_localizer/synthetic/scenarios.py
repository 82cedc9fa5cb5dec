# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Named conditions: the parameters of the synthetic camera that each of them changes."""

from __future__ import annotations

from collections.abc import Mapping
import math

from gip_localizer.errors import ParameterError
from gip_localizer.parameters.spec import Value
from gip_localizer.synthetic.parameters import SyntheticCameraParameters

PAPER_CAMERA: dict[str, Value] = {
    'camera.x': 0.0, 'camera.z': 0.583095, 'camera.pitch': math.radians(35.9020),
    'lens.width': 640, 'lens.height': 323, 'lens.focal': 320.0 / math.tan(math.radians(35.2644)),
}
"""The paper's camera: height 58.3095 cm, pitch 35.902° down, field of view 70.5° x 39.3°."""

SCENARIOS: dict[str, dict[str, Value]] = {
    'clear': {},
    'night': {
        'sensor.gain': 0.22, 'sensor.offset': 0.01, 'sensor.vignetting': 0.3,
        'sensor.full_well': 2000.0, 'sensor.read_noise': 0.004, 'sensor.exposure_time': 0.004,
    },
    'distorted': {
        'lens.k1': -0.3, 'lens.k2': 0.08, 'camera.roll': 0.03, 'camera.yaw': -0.05,
        'camera.x': 1.2, 'camera.y': 0.3, 'world.origin_yaw': 0.4,
    },
    'rain-noise': {
        'disturbance.rain': 0.8, 'sensor.full_well': 1500.0, 'sensor.read_noise': 0.015,
    },
    'glare': {'disturbance.glare': 0.35},
    'shadows': {'disturbance.shadows': 0.5},
    'occlusion': {'disturbance.cars': 0.25},
    'changed': {'world.changed': 0.2},
    'pitch-bumps': {
        'disturbance.pitch': math.radians(0.7), 'disturbance.roll': math.radians(0.2),
        'disturbance.height': 0.01,
    },
    'crown': {'world.crown': 0.025},
    'grade': {'world.grade': 0.06},
    'bank': {'world.bank': 0.04},
    'real-road': {'world.crown': 0.025, 'world.grade': 0.06, 'world.bank': 0.04},
    'relaid': {'world.relaid': 0.6},
    'tone': {'sensor.gamma': 0.6, 'sensor.hunting': 0.2},
    'rolling-shutter': {'sensor.readout_time': 0.025, 'drive.speed': 12.0},
    'nadir': {'camera.z': 8.0, 'camera.pitch': 0.5 * math.pi, 'lens.focal': 700.0},
    'tiles-low-snr': {
        **PAPER_CAMERA, 'world.name': 'tiles', 'world.tile_side': 0.2,
        'world.tile_amplitude': 0.1, 'sensor.gain': 1.0, 'sensor.offset': 0.0,
        'sensor.vignetting': 0.0, 'sensor.full_well': 0.0,
        'sensor.read_noise': 0.1 * 10.0 ** (3.0 / 20.0), 'sensor.exposure_time': 0.0,
        'drive.speed': 1.0,
    },
}
"""Scenario → dotted name → value in the unit of that parameter; all values are chosen."""


def scenario_parameters(
    name: str, overrides: Mapping[str, object] | None = None
) -> SyntheticCameraParameters:
    """
    Return the parameters of a scenario, with further changes applied.

    Raises
    ------
    ParameterError
        The scenario is unknown, or a value is not allowed.

    """
    if name not in SCENARIOS:
        raise ParameterError(f'scenario {name!r} is unknown; expected {", ".join(SCENARIOS)}')
    return SyntheticCameraParameters.from_dict({**SCENARIOS[name], **(overrides or {})})
