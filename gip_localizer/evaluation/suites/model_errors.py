# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
What is wrong with the model of a frame: the road, the map, the calibration, the light, the time.

Each cause has the size that the field reports of it. The truth of a warped map is the pose that
puts the view where the map shows it: the best rigid motion over the view.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Birdseye
from gip_localizer.synthetic.texture import value_noise

WARP_GRAIN_M = 10.0
"""Distance between the nodes of a warp, metres; chosen: there and back takes 20 m."""
_STREAM = 6173
"""Number of the random stream of warps (no unit); chosen: no other stream uses it."""
_POINTS = 12
"""Number of points along each side of the view that fit a rigid motion to a warp; chosen."""


@dataclass(frozen=True)
class Miscalibration:
    """Errors of the calibration (m, rad, share of the focal length)."""

    pitch: float = 0.0
    yaw: float = 0.0
    height: float = 0.0
    focal: float = 0.0

    def of(self, camera: CameraModel) -> CameraModel:
        """Return the camera that the localizer takes it for."""
        held = camera.extrinsics
        calibration = camera.calibration
        if self.focal:
            scale = np.diag([1.0 + self.focal, 1.0 + self.focal, 1.0])
            centre = calibration.K[:, 2].copy()
            K = scale @ calibration.K
            K[:, 2] = centre
            P = scale @ calibration.P
            P[:, 2] = calibration.P[:, 2]
            calibration = replace(calibration, K=K, P=P)
            camera = type(camera)(calibration, held)
        return camera.with_extrinsics(replace(
            held, pitch=held.pitch + self.pitch, yaw=held.yaw + self.yaw,
            z=held.z + self.height,
        ))


class Warp:
    """
    A map that is bent smoothly.

    Parameters
    ----------
    raster : RasterMap
        The map as it should be.
    rms : float
        Of the displacement, metres.
    seed : int
        Same seed, same warp.

    """

    def __init__(self, raster: RasterMap, rms: float, seed: int) -> None:
        rng = np.random.default_rng([seed, _STREAM])
        shape = (raster.grey.shape[0], raster.grey.shape[1])
        ahead, left = (
            value_noise(shape, raster.resolution, WARP_GRAIN_M, rng) for _ in range(2)
        )
        scale = np.float32(rms / math.sqrt(2.0))
        self._raster = raster
        self._shift = np.dstack([ahead, left]) * scale  # m along columns, along rows

    def warped(self) -> RasterMap:
        """Return the bent map."""
        rows, cols = self._raster.grey.shape
        col, row = np.meshgrid(np.arange(cols, dtype=np.float32),
                               np.arange(rows, dtype=np.float32))
        cells = self._shift / np.float32(self._raster.resolution)
        grey = cv2.remap(
            on_unit_scale(self._raster.grey), col - cells[..., 0], row - cells[..., 1],
            cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE,
        )
        return replace(self._raster, grey=np.clip(np.asarray(grey, np.float32), 0.0, 1.0))

    def truth(self, pose: Pose2, view: Birdseye) -> Pose2:
        """Return the pose in the bent map that puts a view where the map shows it."""
        x, y = np.meshgrid(np.linspace(view.near, view.far, _POINTS),
                           np.linspace(-view.half_width, view.half_width, _POINTS))
        points = np.stack([x.ravel(), y.ravel()], axis=1)
        off = self._at(pose.transform(points)) @ pose.rotation()
        ones, none = np.ones(len(points)), np.zeros(len(points))
        columns = np.concatenate([
            np.stack([ones, none, -points[:, 1]], axis=1),
            np.stack([none, ones, points[:, 0]], axis=1),
        ])
        motion, *_ = np.linalg.lstsq(columns, off.T.ravel(), rcond=None)
        return pose @ Pose2(*(float(m) for m in motion))

    def _at(self, xy_map: Floats) -> Floats:
        """Displacements (n, 2) of map points, metres in the map's axes."""
        cells = self._raster.to_cell(xy_map).astype(np.float32)
        found = np.asarray(cv2.remap(
            self._shift, np.ascontiguousarray(cells[None, :, 1]),
            np.ascontiguousarray(cells[None, :, 0]), cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ))[0].astype(float)
        along_rows = np.array([1.0, -1.0])  # rows go down, y goes up
        return np.asarray((found * along_rows) @ self._raster.origin.rotation().T)


