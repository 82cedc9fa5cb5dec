# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion of the vehicle over time: along a loop, along a line, or from a TUM file."""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Protocol

import numpy as np

from gip_localizer.core.pose import Pose2
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import read_tum
from gip_localizer.synthetic.parameters import Drive
from gip_localizer.synthetic.paths import Path

_DELTA = 0.005
"""Half of the interval, in seconds, for the central difference that gives a velocity; chosen."""


@dataclass(frozen=True)
class Twist2:
    """Velocity in the base frame: forward and left in m/s, yaw rate `turn` in rad/s."""

    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


class VehicleMotion(Protocol):
    """Pose and velocity of a vehicle at times from 0 to `duration`, seconds."""

    @property
    def duration(self) -> float:
        """Time until the motion ends, seconds; inf if it never ends."""

    def pose(self, time: float) -> Pose2:
        """Return T_map_base at a time."""

    def twist(self, time: float) -> Twist2:
        """Return the velocity at a time."""


@dataclass(frozen=True)
class PathMotion:
    """Motion along a path at constant speed; without end on a closed path."""

    path: Path
    speed: float
    start: float = 0.0

    @property
    def duration(self) -> float:
        """Time until an open path ends, seconds."""
        if self.path.closed or self.speed == 0.0:
            return math.inf
        return max(self.path.length - self.start, 0.0) / self.speed

    def pose(self, time: float) -> Pose2:
        """Return T_map_base at a time."""
        return self.path.pose(self.start + self.speed * time)

    def twist(self, time: float) -> Twist2:
        """Return the velocity at a time."""
        arc = self.start + self.speed * time
        return Twist2(self.speed, 0.0, self.speed * self.path.curvature(arc))


@dataclass(frozen=True)
class LineMotion:
    """Motion along a straight line from a pose at constant speed."""

    origin: Pose2
    speed: float

    @property
    def duration(self) -> float:
        """A line never ends."""
        return math.inf

    def pose(self, time: float) -> Pose2:
        """Return T_map_base at a time."""
        return self.origin @ Pose2(self.speed * time, 0.0, 0.0)

    def twist(self, time: float) -> Twist2:
        """Return the velocity at a time."""
        return Twist2(self.speed)


@dataclass(frozen=True)
class RecordedMotion:
    """Motion along a recorded trajectory, with the times of the recording."""

    trajectory: Trajectory

    @property
    def duration(self) -> float:
        """Length of the recording, seconds."""
        stamps = self.trajectory.stamps_ns
        return float(stamps[-1] - stamps[0]) * 1e-9

    def pose(self, time: float) -> Pose2:
        """Return T_map_base at a time; outside the recording its first or last pose."""
        stamps = self.trajectory.stamps_ns
        at = int(stamps[0]) + round(time * 1e9)
        inside = np.clip(np.array([at], np.int64), stamps[0], stamps[-1])
        endless = int(stamps[-1] - stamps[0]) + 1
        return Pose2(*self.trajectory.at(inside, endless)[0].tolist())

    def twist(self, time: float) -> Twist2:
        """Return the velocity at a time, as a difference over 10 ms."""
        before, after = max(time - _DELTA, 0.0), min(time + _DELTA, self.duration)
        if after <= before:
            return Twist2()
        step = self.pose(before).inverse() @ self.pose(after)
        span = after - before
        return Twist2(step.x / span, step.y / span, step.yaw / span)


def make_motion(drive: Drive, lane: Path) -> VehicleMotion:
    """
    Return the motion that the parameters define.

    Raises
    ------
    TrajectoryError
        The TUM file is missing or malformed; the message names the line.

    """
    if drive.trajectory == 'loop':
        return PathMotion(lane, drive.speed, drive.start)
    if drive.trajectory == 'line':
        return LineMotion(lane.pose(drive.start), drive.speed)
    return RecordedMotion(read_tum(drive.trajectory))
