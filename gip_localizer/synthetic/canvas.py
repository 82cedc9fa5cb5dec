# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Antialiased coverage masks drawn in metres.

The grid frame has its origin in the raster's lower-left corner, x to the right, y up. OpenCV
draws with sub-pixel vertices (`shift`); masks are 0..1 coverage.

"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

_SHIFT = 4
"""Fractional bits of the vertices that OpenCV draws: positions are exact to 1/16 of a cell."""


@dataclass(frozen=True)
class Canvas:
    """
    A raster to draw on in metres.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns.
    resolution : float
        Metres per cell.

    """

    shape: tuple[int, int]
    resolution: float

    @classmethod
    def of_size(cls, width: float, height: float, resolution: float) -> Canvas:
        """Return the canvas that covers width x height metres."""
        return cls((round(height / resolution), round(width / resolution)), resolution)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height in metres."""
        return self.shape[1] * self.resolution, self.shape[0] * self.resolution

    def polygons(self, outlines: list[Floats]) -> Floats32:
        """Return the coverage of filled (n, 2) outlines in metres, each drawn separately."""
        mask = np.zeros(self.shape, np.uint8)
        for outline in outlines:
            cv2.fillPoly(mask, [self._vertices(outline)], 255, cv2.LINE_AA, _SHIFT)
        return self._coverage(mask)

    def lines(self, paths: list[Floats], width: float) -> Floats32:
        """Return the coverage of (n, 2) open polylines of a width in metres."""
        mask = np.zeros(self.shape, np.uint8)
        thickness = max(1, round(width / self.resolution))
        for path in paths:
            vertices = [self._vertices(path)]
            cv2.polylines(mask, vertices, False, 255, thickness, cv2.LINE_AA, _SHIFT)
        thinning = min(1.0, width / self.resolution)
        return np.asarray(self._coverage(mask) * np.float32(thinning), np.float32)

    def discs(self, centres: Floats, radii: Floats) -> Floats32:
        """Return the coverage of discs, centres (n, 2) and radii (n,) in metres."""
        mask = np.zeros(self.shape, np.uint8)
        scaled = np.rint(radii / self.resolution * (1 << _SHIFT)).astype(int)
        for (u, v), radius in zip(self._vertices(centres).tolist(), scaled.tolist(), strict=True):
            cv2.circle(mask, (u, v), radius, 255, -1, cv2.LINE_AA, _SHIFT)
        return self._coverage(mask)

    def _vertices(self, points: Floats) -> NDArray[np.int32]:
        """Return points in metres as fixed-point pixel positions."""
        cells = np.asarray(points, float) / self.resolution - 0.5
        cells[:, 1] = self.shape[0] - 1 - cells[:, 1]
        return np.rint(cells * (1 << _SHIFT)).astype(np.int32)

    @staticmethod
    def _coverage(mask: NDArray[np.uint8]) -> Floats32:
        return np.asarray(mask, np.float32) / np.float32(255.0)


def rectangle(centre: tuple[float, float], size: tuple[float, float], yaw: float) -> Floats:
    """Return the four corners (4, 2) of a rotated rectangle, metres."""
    half = 0.5 * np.array(size)
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]]) * half
    c, s = np.cos(yaw), np.sin(yaw)
    return np.asarray(corners @ np.array([[c, s], [-s, c]]) + np.array(centre), float)


def paint(grey: Floats32, coverage: Floats32, value: Floats32 | float) -> None:
    """Blend a value into the grey raster, in place, weighted by the coverage."""
    grey += coverage * (np.asarray(value, np.float32) - grey)
