# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Motion of the vehicle since its last fix, and the uncertainty of that motion.

Odometry is used where fixes have confirmed it, else the velocity of the last fixes (constant
velocity model), else the vehicle is assumed to be stationary. The uncertainty grows with the
distance and the time since the last fix, however many frames lie between.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.belief_arithmetic import scaled_motion
from gip_localizer.core.track.odometry import MAX_TURN, OdometryBuffer
from gip_localizer.core.track.odometry_check import (
    MAX_ACCELERATION,
    MAX_TURN_ACCELERATION,
    OdometryCheck,
)
from gip_localizer.parameters import Motion

# Longest time (s) since a fix for which its velocity is extrapolated (design choice: 2 s, because
# a road vehicle can stop or turn within that time).
VELOCITY_AGE_S = 2.0
# Factor (no unit) on the standard deviations that grow with time where no odometry is used (design
# choice: 5, because the velocity of the last fixes does not contain later accelerations).
WITHOUT_ODOMETRY = 5.0


@dataclass(frozen=True, eq=False)
class FilterState:
    """
    Belief, velocity and fixes of the vehicle at one time.

    Attributes
    ----------
    belief : Belief or None
        The last fix, or a prediction since.
    velocity : Pose2 or None
        Mean velocity between the last two fixes (m/s, m/s, rad/s), in base axes.
    last_fix, compared_since : Belief or None
        The last fix, and the fix from which odometry is compared with the fixes.
    origin : Belief or None
        The belief from which `belief` was predicted: the last fix, or an initial pose.

    """

    belief: Belief | None = None
    velocity: Pose2 | None = None
    last_fix: Belief | None = None
    compared_since: Belief | None = None
    origin: Belief | None = None

    def extrapolated(self, elapsed: float, now_ns: int) -> Pose2 | None:
        """Return the motion in `elapsed` seconds up to now at the velocity of the last fixes."""
        velocity, fix = self.velocity, self.last_fix
        if velocity is None or fix is None or (now_ns - fix.stamp_ns) * 1e-9 >= VELOCITY_AGE_S:
            return None
        return scaled_motion(velocity, elapsed)


class MotionModel:
    """
    Predicts the motion between two stamps.

    Parameters
    ----------
    noise : Motion
        Noise of the motion, and the limits of odometry.

    Attributes
    ----------
    odometry : OdometryBuffer
        Recent odometry.
    odometry_check : OdometryCheck
        Whether the fixes confirm the odometry.
    source : str
        Source of the last motion: 'odometry', 'constant velocity' or 'standstill'; 'none' before
        the first motion.

    """

    def __init__(self, noise: Motion) -> None:
        self.noise = noise
        self.odometry = OdometryBuffer(noise)
        self.odometry_check = OdometryCheck()
        self.source = 'none'

    def configure(self, noise: Motion) -> None:
        """Change the noise of the motion."""
        self.noise = self.odometry.limits = noise

    def motion(self, known: FilterState, stamp_ns: int, elapsed: float) -> tuple[Pose2, float]:
        """Return the motion since the belief, and the factor on its uncertainty with time."""
        assert known.belief is not None
        measured = self.odometry.motion(known.belief.stamp_ns, stamp_ns)
        extrapolated = known.extrapolated(elapsed, stamp_ns)
        if measured is not None and self.odometry_check.usable(measured, extrapolated, elapsed):
            self.source = 'odometry'
            return measured, 1.0
        if extrapolated is not None:
            self.source = 'constant velocity'
            return extrapolated, WITHOUT_ODOMETRY
        self.source = 'standstill'
        return Pose2(0.0, 0.0, 0.0), WITHOUT_ODOMETRY

    def between(self, known: FilterState, start_ns: int, end_ns: int) -> Pose2 | None:
        """Return the motion between two stamps from odometry or velocity; None without both."""
        measured = self.odometry.motion(start_ns, end_ns)
        if measured is not None and not self.odometry_check.rejected:
            return measured
        return known.extrapolated((end_ns - start_ns) * 1e-9, end_ns)

    def covariance(
        self, factor: float, driven: tuple[float, float], elapsed: tuple[float, float]
    ) -> Floats:
        """
        Return the covariance (3, 3) of a part of the motion since the last fix.

        Parameters
        ----------
        factor : float
            Factor on the standard deviations that grow with time.
        driven : (float, float)
            Distance (m) from the fix to the start and to the end of the part.
        elapsed : (float, float)
            Time (s) from the fix to the start and to the end of the part.

        """
        noise = self.noise
        far, long = (end**2 - start**2 for start, end in (driven, elapsed))
        xy = noise.sigma_xy_per_m**2 * far + (factor * noise.sigma_xy_per_s) ** 2 * long
        yaw = noise.sigma_yaw_per_m**2 * far + (factor * noise.sigma_yaw_per_s) ** 2 * long
        return np.diag([xy, xy, yaw])

    def largest_deviation(self, seconds: float) -> tuple[float, float]:
        """Return the largest difference (m, rad) of the true motion since a fix from the model."""
        if self.source == 'odometry':
            return 0.0, 0.0
        if self.source == 'constant velocity':
            return MAX_ACCELERATION * seconds**2, MAX_TURN_ACCELERATION * seconds**2
        return self.noise.max_speed * seconds, MAX_TURN * seconds

    def compare(self, since: Belief, fix: Belief) -> bool:
        """
        Compare odometry with the motion between two fixes.

        Returns
        -------
        bool
            True when the comparison is finished, so that the next begins at the later fix.

        """
        measured = self.odometry.motion(since.stamp_ns, fix.stamp_ns)
        if measured is None:
            return True
        elapsed = (fix.stamp_ns - since.stamp_ns) * 1e-9
        driven = math.hypot(measured.x, measured.y)
        spread = since.covariance + fix.covariance
        spread = spread + self.covariance(1.0, (0.0, driven), (0.0, elapsed))
        return self.odometry_check.compare(
            measured, since.pose.inverse() @ fix.pose,
            sigma_xy=math.sqrt(spread[0, 0] + spread[1, 1]),
            sigma_yaw=math.sqrt(spread[2, 2]), elapsed=elapsed,
        )
