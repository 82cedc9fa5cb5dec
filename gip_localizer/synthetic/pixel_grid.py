# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Rays through the corners and the interior of a camera's pixels, and their footprints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.model import CameraModel

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Ints = NDArray[np.int64]


class PixelGrid:
    """
    The rays at the corners of a camera's pixels, and the footprints of the pixels on the road.

    Parameters
    ----------
    camera : CameraModel
        Lens and pose in the base frame.

    """

    def __init__(self, camera: CameraModel) -> None:
        self.shape = (camera.height, camera.width)
        u, v = np.meshgrid(np.arange(camera.width + 1) - 0.5, np.arange(camera.height + 1) - 0.5)
        rays, valid = camera.rays(np.column_stack([u.ravel(), v.ravel()]))
        corner = (camera.height + 1, camera.width + 1)
        self._rays = np.where(valid[:, None], rays, 0.0).reshape(*corner, 2)
        seen = valid.reshape(corner)
        self.visible = seen[:-1, :-1] & seen[1:, :-1] & seen[:-1, 1:] & seen[1:, 1:]
        self.centres = self._at(np.arange(camera.width * camera.height), 0.5, 0.5)

    def footprints(self, camera: CameraModel) -> tuple[Floats, Floats, Floats]:
        """
        Side lengths of the pixels' footprints on a flat road.

        Returns
        -------
        along_u, along_v : (n,) float64
            Lengths of the footprint's sides, metres; inf at and above the horizon.
        rise : (n,) float64
            Sine of the ray's elevation, negative below the horizon.

        """
        pixels = np.arange(self.centres.shape[0])
        rotation, height = camera.R_base_camera, camera.extrinsics.z
        d = self.centres @ rotation[:, :2].T + rotation[:, 2]
        norm = np.linalg.norm(d, axis=1)
        sides = []
        for (u0, v0), (u1, v1) in (((0, 0.5), (1, 0.5)), ((0.5, 0), (0.5, 1))):
            step = (self._at(pixels, u1, v1) - self._at(pixels, u0, v0)) @ rotation[:, :2].T
            slope = np.minimum(d[:, 2], -1e-4 * norm)
            shift = height * (step[:, :2] - d[:, :2] * (step[:, 2] / slope)[:, None])
            sides.append(np.linalg.norm(shift / slope[:, None], axis=1))
        return sides[0], sides[1], d[:, 2] / norm

    def rays_in(
        self, pixels: Ints, strata: tuple[int, int], spread: tuple[Floats, Floats]
    ) -> Floats32:
        """Return the rays (nu * nv, m, 2) at the strata of pixels, scaled by `spread` (m,)."""
        fu, fv = (
            0.5 + by[:, None] * ((np.arange(n) + 0.5) / n - 0.5)
            for n, by in zip(strata, spread, strict=True)
        )
        rays = [
            self._at(pixels, fu[:, i : i + 1], fv[:, j : j + 1])
            for j in range(strata[1]) for i in range(strata[0])
        ]
        return np.asarray(rays, np.float32)

    def _at(self, pixels: Ints, fu: Floats | float, fv: Floats | float) -> Floats:
        """Return the rays (m, 2) at a fraction of each pixel, bilinear between its corners."""
        row, col = np.divmod(pixels, self.shape[1])
        r = self._rays
        top = (1 - fu) * r[row, col] + fu * r[row, col + 1]
        bottom = (1 - fu) * r[row + 1, col] + fu * r[row + 1, col + 1]
        return np.asarray((1 - fv) * top + fv * bottom, float)
