# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Cameras that the tests of the core look through."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel

HELD = Extrinsics(1.2, 0.3, 1.5, 0.03, math.radians(15.0), 0.05)
PLUMB_BOB = np.array([-0.3, 0.1, 0.001, -0.001, 0.01])
RATIONAL = np.array([0.2, 0.05, 0.001, -0.002, 0.01, 0.4, 0.08, 0.02])
PRISM = np.array([*RATIONAL, 0.001, -0.0005, 0.002, 0.0003])
TILTED = np.array([*PRISM, 0.01, -0.02])
EQUIDISTANT = np.array([-0.02, 0.01, -0.003, 0.001])
LENSES = {
    'none': ('plumb_bob', np.zeros(5)),
    'plumb_bob': ('plumb_bob', PLUMB_BOB),
    'plumb_bob-4': ('plumb_bob', PLUMB_BOB[:4]),
    'rational-8': ('rational_polynomial', RATIONAL),
    'rational-12': ('rational_polynomial', PRISM),
    'rational-14': ('rational_polynomial', TILTED),
    'equidistant': ('equidistant', EQUIDISTANT),
}


SMALL_CAMERA = {'size': (320, 180), 'focal': 225.0}
"""A quarter of the pixels: for tests of what is done with frames and not of their pixels."""


def intrinsics(focal: float, width: int, height: int) -> np.ndarray:
    return np.array([
        [focal, 0.0, (width - 1) / 2.0], [0.0, focal, (height - 1) / 2.0], [0.0, 0.0, 1.0],
    ])


def make_calibration(lens: str = 'none', *, size: tuple[int, int] = (640, 360),
                     focal: float = 450.0, **more: object) -> Calibration:
    model, D = LENSES[lens]
    return Calibration(*size, intrinsics(focal, *size), D, model=model, **more)


def make_camera(lens: str = 'none', *, held: Extrinsics = HELD, rectified: bool = False,
                **more: object) -> CameraModel:
    return CameraModel(make_calibration(lens, **more), held, rectified=rectified)


def paper_camera() -> CameraModel:
    """The paper's simulated camera: 58.3 cm high, 35.9 degrees down, 70.5 x 39.3 degrees wide."""
    height, pitch = 0.583095, math.radians(35.9020)
    focal = 640.0 / math.tan(math.radians(70.5288 / 2))
    rows = 2 * math.ceil(focal * math.tan(math.radians(39.2962 / 2)))
    held = Extrinsics(0.0, 0.0, height, 0.0, pitch, 0.0)
    return make_camera(held=held, size=(1280, rows), focal=focal)


def car_camera(lens: str = 'none') -> CameraModel:
    """A car's: 1280 x 720, f = 900 px, 1.5 m high, 15 degrees down, all else not zero."""
    return make_camera(lens, size=(1280, 720), focal=900.0)
