# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Roads that are not flat: crown, grade and bank, as heights above the plane of the map.

The vehicle lies on the tangent plane of the road at its base, as a vehicle on a slope does: what
a camera sees wrong is how far the road ahead leaves that plane.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.synthetic.parameters import Ground
from gip_localizer.synthetic.paths import Path
from gip_localizer.synthetic.world_road import LANE

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

_SPACING = 0.25
"""Side of a cell of the heights, metres; chosen: heights change little within it."""
_REACH = 6.0
"""Distance from the centre line (m) up to which the road slopes across; chosen."""
_RIDGE = 0.3
"""Half-width (m) over which a crown is rounded; chosen."""
_GRADE_PERIOD = 60.0
"""Period (m) of the slope along the road; chosen."""
_BANKED = 0.05
"""Curvature (1/m) from which a curve has its full bank; chosen: a radius of 20 m."""
_RUN_ON = 5.0
"""Standard deviation (m) of the Gaussian that smooths the bank along the road; chosen."""
_STEPS = 5
"""Number of secant steps from the tangent plane to the road; measured: the rest is < 1 mm."""


@dataclass(frozen=True, eq=False)
class RoadShape:
    """
    Heights of a road.

    Attributes
    ----------
    heights : (rows, cols) float32
        Metres above the map's plane; row 0 is the top.
    cells : float
        Cells of the world in a side of one of these.
    resolution : float
        Side of a cell of the world, metres.

    """

    heights: Floats32
    cells: float
    resolution: float

    def at(self, cells: Floats32) -> Floats32:
        """Return the heights (...,) at cells (..., 2) (column, row) of the world."""
        own = (cells + np.float32(0.5)) / np.float32(self.cells) - np.float32(0.5)
        return np.asarray(cv2.remap(
            self.heights, np.ascontiguousarray(own), None, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_REPLICATE,
        ))

    def tangent(self, cell: Floats, axes: Floats) -> Floats32:
        """
        Return the tangent plane (3,) at a cell: its height is p @ (column, row, 1).

        Parameters
        ----------
        cell : (2,)
            Column and row of the base.
        axes : (2, 2)
            Directions ahead and left, in cells for a metre (rows).

        """
        points = np.stack([cell, *(cell + s * a for a in axes for s in (-1.0, 1.0))])
        z = self.at(points[None].astype(np.float32))[0].astype(float)
        slopes = np.array([z[2] - z[1], z[4] - z[3]]) / 2.0
        gradient = np.linalg.solve(axes, slopes)
        return np.array([*gradient, z[0] - gradient @ cell], np.float32)

    def met(self, flat: Floats32, camera: Floats, height: float, plane: Floats32) -> Floats32:
        """
        Return the cells (..., 2) where rays meet the road.

        Parameters
        ----------
        flat : (..., 2) float32
            Where they meet the tangent plane.
        camera : (2,)
            Cell below the camera.
        height : float
            Of the camera above the tangent plane, metres.
        plane : (3,) float32
            Of `tangent`.

        """
        away = np.asarray(camera, np.float32) - flat

        def excess(share: Floats32) -> Floats32:
            point = flat + away * share[..., None]
            rise = self.at(point) - (point @ plane[:2] + plane[2])
            return np.asarray(rise / np.float32(height) - share, np.float32)

        before = np.zeros(flat.shape[:-1], np.float32)
        missed = excess(before)
        share = np.clip(missed, -0.5, 0.5)
        for _ in range(_STEPS):
            now = excess(share)
            change = share - before
            steep = np.where(np.abs(now - missed) > 1e-7, now - missed, np.float32(-1.0))
            step = np.where(np.abs(change) > 1e-7, -now * change / steep, np.float32(0.0))
            before, missed = share, now
            share = np.clip(share + step, -0.5, 0.5)
        return np.asarray(flat + away * share[..., None], np.float32)


def make_shape(ground: Ground, raster: RasterMap, lane: Path) -> RoadShape | None:
    """Return the shape that the parameters select; None: flat."""
    if not (ground.crown or ground.grade or ground.bank):
        return None
    width, height = raster.size_m
    rows, cols = math.ceil(height / _SPACING), math.ceil(width / _SPACING)
    side = _SPACING / raster.resolution
    top = raster.grey.shape[0]
    col, row = np.meshgrid(np.arange(cols), np.arange(rows))
    at = [(top - (row + 0.5) * side) * raster.resolution, (col + 0.5) * _SPACING]
    points = raster.origin.transform(
        np.stack([at[1].ravel(), at[0].ravel()], axis=1).astype(float)
    )
    centre = lane.shifted(0.5 * LANE)
    along, left = _beside(centre, np.asarray(points, float))
    total = np.zeros(len(points))
    if ground.crown:
        total -= ground.crown * (np.hypot(left, _RIDGE) - _RIDGE)
    if ground.grade:
        waves = 2.0 * math.pi * max(round(centre.length / _GRADE_PERIOD), 1) / centre.length
        total -= 0.5 * ground.grade / waves * np.cos(waves * along)
    if ground.bank:
        total -= left * _tilt(centre, ground.bank)(along)
    return RoadShape(total.reshape(rows, cols).astype(np.float32), side, raster.resolution)


def _beside(centre: Path, points: Floats) -> tuple[Floats, Floats]:
    """Return the arc length and the distance to the left, within reach, of points (n, 2)."""
    arcs = centre.stations
    _, nearest = cKDTree(centre.position(arcs)).query(points)
    along = arcs[nearest]
    away = points - centre.position(along)
    yaw = centre.heading(along)
    along = np.asarray(along + away[:, 0] * np.cos(yaw) + away[:, 1] * np.sin(yaw), float)
    left = -away[:, 0] * np.sin(yaw) + away[:, 1] * np.cos(yaw)
    return along, np.clip(left, -_REACH, _REACH)


def _tilt(centre: Path, bank: float) -> Callable[[Floats], Floats]:
    """Return the cross slope by arc length, rad: the outside of a curve lies higher."""
    arcs = centre.stations
    share = np.clip([centre.curvature(float(a)) / _BANKED for a in arcs], -1.0, 1.0)
    spacing = float(arcs[1] - arcs[0])
    mode = 'wrap' if centre.closed else 'nearest'
    tilt = bank * gaussian_filter1d(share, _RUN_ON / spacing, mode=mode)

    def at(along: Floats) -> Floats:
        return np.interp(np.mod(along, centre.length), arcs, tilt)

    return at


def place_of(raster: RasterMap, pose: Pose2) -> tuple[Floats, Floats]:
    """Return the cell (column, row) of a pose, and its axes ahead and left (2, 2), cells/m."""
    local = raster.origin.inverse() @ pose
    scale = 1.0 / raster.resolution
    cell = np.array([local.x * scale - 0.5, raster.grey.shape[0] - 0.5 - local.y * scale])
    c, s = math.cos(local.yaw), math.sin(local.yaw)
    return cell, scale * np.array([[c, -s], [-s, -c]])
