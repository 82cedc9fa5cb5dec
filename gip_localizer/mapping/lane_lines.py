# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Lane lines in a bird's-eye view, and the pitch error that their directions show.

A camera at height h sees a road point at distance x under the depression angle φ = atan(h / x).
If the assumed pitch is too large by δ, the point is mapped to h / tan(φ + δ) ≈ x - δ x²/h, and
its lateral offset y becomes y (1 - δ x/h): a line at y gets the slope -δ y/h. Therefore δ = -k h
if the slopes depend linearly on the offset, b = b0 + k y; b0 is the heading relative to the road.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye.rectifier import View

PAINT = 0.35
"""Largest width of a painted line, metres; chosen: lane lines are 0.10 to 0.30 m wide."""
LEAST_RISE = 0.04
"""Least grey of paint above the neighbouring road, of [0, 1]; chosen."""
SLOPES = np.linspace(-0.35, 0.35, 141)
"""Tested slopes of lines, metres to the left per metre ahead: up to 19° in steps of 0.3°."""
NEAR_LINE = 0.10
"""Largest distance of a point from its line, metres; chosen."""
LEAST_LENGTH = 3.0
"""Least length of a line, metres; chosen."""
LEAST_SHARE = 0.4
"""Least painted fraction of the length of a line; chosen for dashes with equal gaps."""
STRAIGHT = 0.04
"""Largest root mean square distance of the points of a straight line, metres; chosen."""
MOST_LINES = 6
"""Largest number of lines per view; chosen."""
LEAST_APART = 2.0
"""Least distance of the outermost lines for a pitch estimate, metres; chosen."""


@dataclass(frozen=True)
class LaneLine:
    """
    A straight painted line.

    Attributes
    ----------
    offset : float
        Metres to the left of the vehicle's axis, at the position of the camera.
    slope : float
        Metres to the left per metre ahead.
    start, end : float
        Metres ahead of the camera.
    residual : float
        Root mean square distance of its points, metres.

    """

    offset: float
    slope: float
    start: float
    end: float
    residual: float


def lane_lines(view: View, camera_x: float) -> list[LaneLine]:
    """
    Detect straight painted lines; the line with the most points comes first.

    Parameters
    ----------
    view : View
        Bird's-eye view.
    camera_x : float
        Position of the camera ahead of base_link, metres.

    """
    points = _ridge_points(view, camera_x)
    lines: list[LaneLine] = []
    while len(points) and len(lines) < MOST_LINES:
        near = _best_supported(points)
        line = _fitted(points[near], view.grid.resolution)
        points = points[~near]
        if line is None:
            break
        if line.residual < STRAIGHT:
            lines.append(line)
    return lines


def pitch_excess(lines: list[LaneLine], height: float) -> float | None:
    """
    Assumed minus true pitch, estimated from the slopes of the lines, radians.

    Returns
    -------
    float or None
        None without two lines that are `LEAST_APART` apart.

    """
    if not lines:
        return None
    offsets = np.array([line.offset for line in lines])
    slopes = np.array([line.slope for line in lines])
    if np.ptp(offsets) < LEAST_APART:
        return None
    lengths = np.array([line.end - line.start for line in lines])
    growth, _ = np.polyfit(offsets, slopes, 1, w=lengths)
    return float(-growth * height)


def _ridge_points(view: View, camera_x: float) -> Floats:
    """Return centre points of bright stripes, (n, 2): metres ahead of the camera and left."""
    grid = view.grid
    width = max(round(2.0 * PAINT / grid.resolution), 3) | 1
    grey = np.where(view.valid, view.patch, np.nan)
    filled = np.where(view.valid, view.patch, np.nanmedian(grey)).astype(np.float32)
    along = max(round(0.3 / grid.resolution), 1)
    smooth = cv2.blur(filled, (1, along))
    rise = smooth - cv2.blur(smooth, (width, 1))
    inside = cv2.erode(view.valid.astype(np.uint8), np.ones((1, width), np.uint8)) > 0
    rows, cols = np.nonzero(
        inside[:, 1:-1] & (rise[:, 1:-1] > LEAST_RISE) & (rise[:, 1:-1] >= rise[:, :-2])
        & (rise[:, 1:-1] > rise[:, 2:])
    )  # fmt: skip
    left, middle, right = (rise[rows, cols + k] for k in range(3))
    shift = 0.5 * (left - right) / np.minimum(left - 2.0 * middle + right, -1e-9)
    x = grid.far - (rows + 0.5) * grid.resolution - camera_x
    y = grid.left - (cols + 1.5 + shift) * grid.resolution
    return np.column_stack([x, y]).astype(np.float64)


def _best_supported(points: Floats) -> Bools:
    """Return which points lie on the line with the most votes (Hough transform)."""
    best, chosen = -1, np.zeros(len(points), bool)
    for slope in SLOPES:
        offsets = points[:, 1] - slope * points[:, 0]
        bins = np.round(offsets / NEAR_LINE).astype(int)
        values, counts = np.unique(bins, return_counts=True)
        if counts.max() > best:
            best = int(counts.max())
            chosen = np.abs(offsets - values[counts.argmax()] * NEAR_LINE) < NEAR_LINE
    return chosen


def _fitted(points: Floats, resolution: float) -> LaneLine | None:
    """Fit a line; None if it is too short or has too many gaps."""
    if len(points) < 10:
        return None
    start, end = float(points[:, 0].min()), float(points[:, 0].max())
    rows = len(np.unique(np.round(points[:, 0] / resolution)))
    if end - start < LEAST_LENGTH or rows * resolution < LEAST_SHARE * (end - start):
        return None
    slope, offset = np.polyfit(points[:, 0], points[:, 1], 1)
    residual = points[:, 1] - slope * points[:, 0] - offset
    return LaneLine(
        float(offset), float(slope), start, end, math.sqrt(float(np.mean(residual**2)))
    )
