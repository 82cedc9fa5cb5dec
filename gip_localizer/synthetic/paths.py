# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Smooth paths in the plane, parametrized by arc length: closed loops and open lines.

A path is a periodic or natural cubic spline through its points, which makes heading and
curvature continuous.

"""

from __future__ import annotations

from functools import cached_property
import math

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d

from gip_localizer.core.pose import Pose2, wrap_angle

Floats = NDArray[np.float64]

_SPACING = 0.1
"""Distance between the points of a smoothed path, metres; chosen."""


class Path:
    """
    A planar path, parametrized by arc length.

    Parameters
    ----------
    points : (n, 2) float64
        Points in order, metres; the first is not repeated at the end of a closed path.
    closed : bool
        True when the path returns to its first point.

    """

    def __init__(self, points: Floats, *, closed: bool) -> None:
        self.closed = closed
        knots = np.asarray(points, float)
        if closed:
            knots = np.vstack([knots, knots[:1]])
        self._lengths = cumulative_length(knots)
        kind = 'periodic' if closed else 'natural'
        self._spline = CubicSpline(self._lengths, knots, bc_type=kind)

    @property
    def length(self) -> float:
        """Length of the path, metres."""
        return float(self._lengths[-1])

    def position(self, arc: Floats) -> Floats:
        """Return the (n, 2) positions at arc lengths (n,)."""
        return np.asarray(self._spline(self._within(arc)), float)

    def heading(self, arc: Floats) -> Floats:
        """Return the headings (n,) at arc lengths (n,), rad."""
        tangent = self._spline(self._within(arc), 1)
        return np.asarray(np.arctan2(tangent[..., 1], tangent[..., 0]), float)

    def pose(self, arc: float) -> Pose2:
        """Return the pose at an arc length: on the path, heading along it."""
        at = np.array([arc])
        (x, y), yaw = self.position(at)[0], self.heading(at)[0]
        return Pose2(float(x), float(y), wrap_angle(float(yaw)))

    def curvature(self, arc: float) -> float:
        """Return the curvature at an arc length, 1/m, positive to the left."""
        at = self._within(np.array([arc]))
        (dx, dy), (ddx, ddy) = self._spline(at, 1)[0], self._spline(at, 2)[0]
        return float((dx * ddy - dy * ddx) / math.hypot(dx, dy) ** 3)

    def offset_positions(self, arc: Floats, left: Floats | float) -> Floats:
        """Return the positions (n, 2) at arc lengths (n,), `left` metres to the left."""
        yaw = self.heading(arc)
        normal = np.column_stack([-np.sin(yaw), np.cos(yaw)])
        shift = np.broadcast_to(np.asarray(left, float), np.shape(arc))
        return np.asarray(self.position(arc) + shift[:, None] * normal, float)

    def shifted(self, left: float) -> Path:
        """Return the parallel path, `left` metres to the left of this one."""
        return Path(self.offset_positions(self.stations, left), closed=self.closed)

    @cached_property
    def stations(self) -> Floats:
        """Arc lengths about 0.25 m apart, without the end point of a closed path."""
        count = max(8, math.ceil(self.length / 0.25))
        return np.linspace(0.0, self.length, count, endpoint=not self.closed)

    def _within(self, arc: Floats) -> Floats:
        """Return arc lengths wrapped (closed) or limited (open) to the path."""
        if self.closed:
            return np.asarray(np.mod(arc, self.length), float)
        return np.clip(arc, 0.0, self.length)


def cumulative_length(points: Floats) -> Floats:
    """Return the length of the polyline up to each of its (n, 2) points, metres."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def rounded_loop(corners: Floats, rounding: float) -> Path:
    """
    Return a closed path along a polygon with rounded corners.

    The polygon is smoothed along its length by a Gaussian of `rounding` metres: straight sides
    stay straight, and curvature is continuous.

    """
    closed = np.vstack([corners, corners[:1]])
    lengths = cumulative_length(closed)
    arcs = np.linspace(0.0, lengths[-1], math.ceil(lengths[-1] / _SPACING), endpoint=False)
    dense = np.column_stack([np.interp(arcs, lengths, closed[:, i]) for i in range(2)])
    smooth = gaussian_filter1d(dense, rounding / _SPACING, axis=0, mode='wrap')
    return Path(smooth[::5], closed=True)


def rectangle_loop(low: Floats, high: Floats, rounding: float) -> Path:
    """Return a counter-clockwise rounded rectangle between two corners, metres."""
    (x0, y0), (x1, y1) = low, high
    start = 0.5 * (x0 + x1)
    corners = np.array([[start, y0], [x1, y0], [x1, y1], [x0, y1], [x0, y0]])
    return rounded_loop(corners, rounding)
