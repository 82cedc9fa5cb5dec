# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the cells' rays meet the road when the suspension has moved the camera."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import View
from gip_localizer.core.camera import CameraModel

SMALL = 1e-5  # rad and m, for the tangents


class CameraSway:
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
        self.points = points.astype(np.float32)
        ahead = points - camera.extrinsics.position()[:2]
        heights = np.full(len(points), -camera.extrinsics.z)
        self._rays = np.column_stack([ahead, heights]).astype(np.float32)
        self._planes = [np.ascontiguousarray(self._rays[:, k]) for k in range(3)]
        self.tangents = [self._tangent(unit) for unit in np.eye(3)]

    def road_points(self, motion: Floats) -> Floats:
        """Return the road points (n, 2) float32 for a motion (3,): pitch, roll (rad), height."""
        if not motion.any():
            return self.points
        x, y, z = self._turn(motion)
        scale = np.float32(-(self._pose.z + motion[2])) / np.minimum(z, np.float32(-1e-3))
        here = np.float32(self._pose.x), np.float32(self._pose.y)
        return np.stack([here[0] + x * scale, here[1] + y * scale], axis=1)

    def _turn(self, motion: Floats) -> list[Floats]:
        moved = replace(
            self._pose, pitch=self._pose.pitch + motion[0], roll=self._pose.roll + motion[1]
        )
        turn = (moved.rotation() @ self._pose.rotation().T).astype(np.float32)
        a, b, c = self._planes
        return [turn[k, 0] * a + turn[k, 1] * b + turn[k, 2] * c for k in range(3)]

    def _tangent(self, unit: Floats) -> Floats:
        """Motion of the road points (n, 2) per unit of one component."""
        nominal, height = self._rays.astype(np.float64), self._pose.z
        if unit[2]:
            return (nominal[:, :2] / height).astype(np.float32)
        turned = replace(
            self._pose, pitch=self._pose.pitch + SMALL * unit[0],
            roll=self._pose.roll + SMALL * unit[1],
        )
        rays = nominal @ (turned.rotation() @ self._pose.rotation().T).T
        moved = rays[:, :2] * (-height / np.minimum(rays[:, 2], -1e-3))[:, None]
        return ((moved - nominal[:, :2]) / SMALL).astype(np.float32)


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
