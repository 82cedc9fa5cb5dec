# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the cells' rays meet the road when the suspension has moved the camera."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.camera.model import CameraModel

# Step (rad, m) of the finite differences of the tangents (design choice: 1e-5, because curvature
# and rounding are both negligible there).
SMALL = 1e-5


class SuspensionMotion:
    """
    Road points of fixed pixels as a function of (pitch, roll, height) changes.

    Parameters
    ----------
    camera : CameraModel
        The calibrated pose.
    points : (n, 2) float64
        Road points in base that the pixels see from the calibrated pose.

    """

    def __init__(self, camera: CameraModel, points: Floats) -> None:
        self._pose = camera.extrinsics
        self.x, self.y = _planes(points)
        ahead = points - camera.extrinsics.position()[:2]
        heights = np.full(len(points), -camera.extrinsics.z)
        self._rays = np.column_stack([ahead, heights])
        self._planes = [np.ascontiguousarray(k, np.float32) for k in self._rays.T]
        self.tangents = [self._tangent(unit) for unit in np.eye(3)]

    def road_points(self, motion: Floats) -> tuple[Floats, Floats]:
        """Return x and y (n,) float32 of the road points: motion is pitch, roll (rad), height."""
        if not motion.any():
            return self.x, self.y
        x, y, z = self._turn(motion)
        scale = np.float32(-(self._pose.z + motion[2])) / np.minimum(z, np.float32(-1e-3))
        return np.float32(self._pose.x) + x * scale, np.float32(self._pose.y) + y * scale

    def _turn(self, motion: Floats) -> list[Floats]:
        moved = replace(
            self._pose, pitch=self._pose.pitch + motion[0], roll=self._pose.roll + motion[1]
        )
        turn = (moved.rotation() @ self._pose.rotation().T).astype(np.float32)
        a, b, c = self._planes
        return [turn[k, 0] * a + turn[k, 1] * b + turn[k, 2] * c for k in range(3)]

    def _tangent(self, unit: Floats) -> tuple[Floats, Floats]:
        """Motion in x and y (n,) of the road points per unit of one component."""
        height = self._pose.z
        if unit[2]:
            return _planes(self._rays[:, :2] / height)
        turned = replace(
            self._pose, pitch=self._pose.pitch + SMALL * unit[0],
            roll=self._pose.roll + SMALL * unit[1],
        )
        rays = self._rays @ (turned.rotation() @ self._pose.rotation().T).T
        moved = rays[:, :2] * (-height / np.minimum(rays[:, 2], -1e-3))[:, None]
        return _planes((moved - self._rays[:, :2]) / SMALL)


def _planes(points: Floats) -> tuple[Floats, Floats]:
    """Columns of (n, 2) as contiguous float32."""
    x, y = (np.ascontiguousarray(k, np.float32) for k in points.T)
    return x, y


def pitched(camera: CameraModel, view: View, weight: Floats, pitch: float) -> tuple[View, Floats]:
    """
    Redraw a view as if the camera had been pitched by so much more (rad) than calibrated.

    Returns
    -------
    view : View
        Values and footprints moved to where the road points then are (bilinear).
    weight : (rows, cols) float32
        The weights moved likewise.

    """
    if pitch == 0.0:
        return view, weight
    pose, grid = camera.extrinsics, view.grid
    moved = replace(pose, pitch=pose.pitch + pitch)
    ahead = grid.points() - pose.position()[:2]
    rays = np.column_stack([ahead, np.full(len(ahead), -pose.z)])
    rays = rays @ (pose.rotation() @ moved.rotation().T).T
    source = pose.position()[:2] + rays[:, :2] * (-pose.z / np.minimum(rays[:, 2], -1e-3))[:, None]
    row, col = (k.reshape(grid.shape).astype(np.float32) - 0.5 for k in grid.cell_of(source))
    planes = np.dstack([weight, weight * view.patch, view.footprint]).astype(np.float32)
    taken = np.asarray(cv2.remap(planes, col, row, cv2.INTER_LINEAR,
                                 borderMode=cv2.BORDER_CONSTANT))
    total = np.ascontiguousarray(taken[..., 0])
    patch = taken[..., 1] / np.maximum(total, np.float32(1e-20))
    footprint = np.ascontiguousarray(taken[..., 2])
    return View(patch, footprint, total > 0.0, grid), total
