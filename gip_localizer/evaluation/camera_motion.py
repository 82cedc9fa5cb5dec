# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Mean pitch, roll, height and gain over a drive, and the calibration that they indicate.

Every match estimates how far the camera is from its calibrated mounting pose. A suspension moves
it about a mean of zero; a mean that differs from zero is an error of the calibration.

"""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.evaluation.run import FrameResult
from gip_localizer.parameters import Parameters


class MotionAxis(NamedTuple):
    """A figure of every match, its key and scale in `metrics.json`, and what it corrects."""

    figure: str
    key: str
    scale: float
    parameter: str
    prior: str


MOTIONS = (
    MotionAxis('pitch_rad', 'pitch_deg', math.degrees(1.0), 'camera.pitch',
               'camera_motion.sigma_pitch'),
    MotionAxis('roll_rad', 'roll_deg', math.degrees(1.0), 'camera.roll',
               'camera_motion.sigma_roll'),
    MotionAxis('height_m', 'height_m', 1.0, 'camera.z', 'camera_motion.sigma_height'),
)
GAIN = 'gain'
LEAST_SHARE = 0.5
"""Least mean, as a share of the prior's standard deviation, that is reported as an error of the
calibration (no unit); chosen."""


def mean_camera_motion(estimates: Sequence[FrameResult]) -> dict[str, float | None]:
    """
    Return the means over the published frames; None where no frame has the figure.

    Returns
    -------
    dict
        `pitch_deg`, `roll_deg` and `height_m` relative to the calibration, and `gain` of the
        image relative to the map.

    """
    means: dict[str, float | None] = {}
    for motion in MOTIONS:
        values = _values(estimates, motion.figure)
        means[motion.key] = float(values.mean()) * motion.scale if len(values) else None
    gains = _values(estimates, GAIN)
    means[GAIN] = float(gains.mean()) if len(gains) else None
    return means


def corrections(estimates: Sequence[FrameResult], parameters: Parameters) -> dict[str, float]:
    """
    Return parameters of the camera that the drive contradicts, with the values that it supports.

    A mean counts if it exceeds both `LEAST_SHARE` of the prior and the standard deviation over
    the frames, so that the motion of the suspension is not taken for an error.

    """
    given = parameters.to_dict()
    found = {}
    for motion in MOTIONS:
        values = _values(estimates, motion.figure)
        if not len(values):
            continue
        mean = float(values.mean())
        if abs(mean) > max(LEAST_SHARE * _number(given[motion.prior]), float(values.std())):
            found[motion.parameter] = _number(given[motion.parameter]) + mean
    return found


def correction_notes(estimates: Sequence[FrameResult], parameters: Parameters) -> list[str]:
    """Return what to correct, in one sentence with values; nothing if nothing is wrong."""
    found = corrections(estimates, parameters)
    if not found:
        return []
    given = parameters.to_dict()
    settings = ', '.join(
        f'{name}={value:.4f} (now {_number(given[name]):.4f})' for name, value in found.items()
    )
    return [
        'the camera is not where its calibration has it, on the mean of the drive: try '
        f'{settings}, and replay again until the means are near zero. Height and pitch compensate '
        'each other: measure the height first'
    ]


def _values(estimates: Sequence[FrameResult], figure: str) -> Floats:
    return np.array([
        estimate.quality[figure] for estimate in estimates
        if estimate.pose is not None and figure in estimate.quality
    ], np.float64)


def _number(value: object) -> float:
    assert isinstance(value, (int, float))
    return float(value)
