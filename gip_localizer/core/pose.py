# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Planar poses, SE(2): x, y in metres, yaw in radians, counter-clockwise (REP 103).

`T_a_b` takes b coordinates to a; it is the pose of b in a. `T_a_c = T_a_b @ T_b_c`.

"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats


def wrap_angle(angle: float) -> float:
    """Return the angle (rad) wrapped to [-π, π)."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


class Pose2(NamedTuple):
    """
    A pose in the plane, which is also the transform from its frame to the parent frame.

    Attributes
    ----------
    x, y : float
        Position, metres.
    yaw : float
        Heading, radians, counter-clockwise from the x axis.

    """

    x: float
    y: float
    yaw: float

    def __matmul__(self, other: Pose2) -> Pose2:
        """Compose: `T_a_b @ T_b_c` is `T_a_c`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(
            self.x + c * other.x - s * other.y,
            self.y + s * other.x + c * other.y,
            wrap_angle(self.yaw + other.yaw),
        )

    def inverse(self) -> Pose2:
        """Return `T_b_a` of `T_a_b`."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return Pose2(
            -c * self.x - s * self.y, s * self.x - c * self.y, wrap_angle(-self.yaw)
        )

    def rotation(self) -> Floats:
        """Return the (2, 2) rotation matrix."""
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        return np.array([[c, -s], [s, c]])

    def transform(self, xy: Floats) -> Floats:
        """Take (..., 2) points of frame b to frame a."""
        return np.asarray(xy) @ self.rotation().T + np.array([self.x, self.y])

    def distance(self, other: Pose2) -> float:
        """Return the distance to another position, metres."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def is_finite(self) -> bool:
        """Whether all three numbers are finite."""
        return all(math.isfinite(value) for value in self)


def difference(estimate: Pose2, truth: Pose2) -> Floats:
    """Return estimate - truth as (3,): x, y in metres, yaw in radians, wrapped."""
    return np.array(
        [estimate.x - truth.x, estimate.y - truth.y, wrap_angle(estimate.yaw - truth.yaw)]
    )


def interpolate(start: Pose2, end: Pose2, fraction: float) -> Pose2:
    """Return the pose at a fraction of the way (linear in x and y, shortest way in yaw)."""
    return Pose2(
        start.x + fraction * (end.x - start.x),
        start.y + fraction * (end.y - start.y),
        wrap_angle(start.yaw + fraction * wrap_angle(end.yaw - start.yaw)),
    )
