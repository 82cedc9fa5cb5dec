# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Wheel odometry with drift: true steps with scale error, yaw drift and noise, then summed.

The noise is a random walk over the driven distance: after s metres its variance is noise² · s,
for any message rate. The odometry starts at the origin of `odom`.

"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.synthetic.motions import VehicleMotion
from gip_localizer.synthetic.parameters import Odometry

Floats = NDArray[np.float64]

_STREAM = 7001
"""Number of the odometry's random stream (no unit); chosen: no other stream uses it."""


@dataclass(frozen=True, eq=False)
class OdometryReading:
    """
    One odometry message.

    Attributes
    ----------
    sample : OdometrySample
        Stamp, pose in odom, velocity.
    pose_covariance, twist_covariance : (3, 3) float64
        Of (x, y, yaw) and (forward, left, turn).

    """

    sample: OdometrySample
    pose_covariance: Floats
    twist_covariance: Floats


def odometry_readings(
    motion: VehicleMotion, settings: Odometry, *, seed: int, start_ns: int
) -> Iterator[OdometryReading]:
    """Yield readings at the odometry's rate until the motion ends; same seed, same readings."""
    rng = np.random.default_rng([seed, _STREAM])
    pose, covariance = Pose2(0.0, 0.0, 0.0), np.diag([1e-6, 1e-6, 1e-8])
    before = motion.pose(0.0)
    index = 0
    while (time := index / settings.rate) <= motion.duration + 1e-9:
        now = motion.pose(time)
        step = before.inverse() @ now
        noisy, variance = _measured_step(step, settings, rng)
        pose, covariance = pose @ noisy, covariance + np.diag(variance)
        twist = motion.twist(time)
        sigma = np.sqrt(variance) * settings.rate
        forward, left, turn = np.array([twist.forward, twist.left, twist.turn]) + (
            sigma * rng.standard_normal(3)
        )
        stamp = start_ns + round(time * 1e9)
        sample = OdometrySample(stamp, pose, float(forward), float(left), float(turn))
        yield OdometryReading(sample, covariance.copy(), np.diag(sigma**2 + 1e-6))
        before = now
        index += 1


def _measured_step(
    step: Pose2, settings: Odometry, rng: np.random.Generator
) -> tuple[Pose2, Floats]:
    """Return a step as the odometry measures it, and the variance (3,) of its noise."""
    distance = math.hypot(step.x, step.y)
    variance = distance * np.array(
        [settings.noise_xy**2, settings.noise_xy**2, settings.noise_yaw**2]
    )
    dx, dy, dyaw = np.sqrt(variance) * rng.standard_normal(3)
    scale = 1.0 + settings.scale_error
    yaw_error = settings.yaw_drift * distance + dyaw
    half_turn = Pose2(0.0, 0.0, 0.5 * yaw_error)  # half before the step, half after it
    measured = Pose2(step.x * scale + dx, step.y * scale + dy, step.yaw)
    return half_turn @ measured @ half_turn, variance
