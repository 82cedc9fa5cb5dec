# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""z, roll and pitch of the published poses: not estimated, but taken from another source."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.io.messages import PLANAR
from gip_localizer.parameters.integration import Attitude

CHANNELS = [2, 3, 4]
"""Indices (no unit) of z, roll and pitch in the 6 x 6 covariance: REP 103, geometry_msgs."""


class Tilt(NamedTuple):
    """
    The coordinates that a planar pose does not have.

    Attributes
    ----------
    z : float
        Height of the vehicle's base in the map frame, metres.
    roll, pitch : float
        Radians, about x and y of the vehicle (REP 103).

    """

    z: float = 0.0
    roll: float = 0.0
    pitch: float = 0.0

    def quaternion(self, yaw: float) -> tuple[float, float, float, float]:
        """Return x, y, z, w of Rz(yaw) Ry(pitch) Rx(roll)."""
        (sr, cr), (sp, cp), (sy, cy) = (
            (math.sin(angle / 2.0), math.cos(angle / 2.0))
            for angle in (self.roll, self.pitch, yaw)
        )
        return (sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


def tilt_of(pose: Any) -> Tilt | None:
    """Return z, roll and pitch of a geometry_msgs/Pose; None where they are not finite."""
    q = pose.orientation
    numbers = (float(pose.position.z), q.x, q.y, q.z, q.w)
    if not all(math.isfinite(value) for value in numbers):
        return None
    roll = math.atan2(2.0 * (q.w * q.x + q.y * q.z), 1.0 - 2.0 * (q.x**2 + q.y**2))
    pitch = math.asin(min(max(2.0 * (q.w * q.y - q.z * q.x), -1.0), 1.0))
    return Tilt(numbers[0], roll, pitch)


class AttitudeSource:
    """
    Keeps the newest z, roll and pitch of the source that `attitude.source` names.

    Parameters
    ----------
    settings : Attitude
        Source, values and standard deviations.

    """

    def __init__(self, settings: Attitude) -> None:
        self.settings = settings
        self._received: Tilt | None = None

    def take(self, role: str, pose: Any) -> None:
        """Store z, roll and pitch of a geometry_msgs/Pose if its role is the source."""
        if role == self.settings.source:
            self._received = tilt_of(pose) or self._received

    @property
    def tilt(self) -> Tilt:
        """The newest values of the source; those of the parameters before its first message."""
        settings = self.settings
        if settings.source == 'parameter' or self._received is None:
            return Tilt(settings.z, settings.roll, settings.pitch)
        return self._received

    def covariance(self, planar: Floats) -> Floats:
        """Return (36,), row-major of x y z roll pitch yaw, of a (3, 3) of x, y, yaw."""
        settings, full = self.settings, np.zeros((6, 6))
        full[PLANAR] = planar
        full[CHANNELS, CHANNELS] = np.square(
            [settings.sigma_z, settings.sigma_tilt, settings.sigma_tilt]
        )
        return full.ravel()
