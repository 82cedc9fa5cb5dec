# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose of the camera on the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gip_localizer.core.arrays import Floats

# Rotation matrix (no unit) from the body frame of the camera (x forward) to its optical frame (z
# forward), by REP 103.
OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@dataclass(frozen=True)
class Extrinsics:
    """
    Pose of the camera body (x forward, y left, z up) in the base frame.

    `R_base_camera = Rz(yaw) Ry(pitch) Rx(roll)`; metres and radians; positive pitch is nose
    down (the paper's θ); z is the height above the road (the paper's h).

    """

    x: float = 0.0
    y: float = 0.0
    z: float = 1.5
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def rotation(self) -> Floats:
        """Return R_base_optical, (3, 3): optical axes (z forward, x right) in base."""
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        cp, sp = np.cos(self.pitch), np.sin(self.pitch)
        cy, sy = np.cos(self.yaw), np.sin(self.yaw)
        rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        rotation: Floats = rz @ ry @ rx @ OPTICAL_FROM_BODY.T
        return rotation

    def position(self) -> Floats:
        """Return the camera position in base, (3,) metres."""
        return np.array([self.x, self.y, self.z])
