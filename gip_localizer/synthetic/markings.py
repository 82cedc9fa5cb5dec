# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Road paint as outlines in metres: lane lines, stop lines, crosswalks and arrows.

Everything is placed by (s, d): arc length along the centre line and metres to its left. The
traffic keeps right, so the lane that follows the centre line lies at d < 0.

"""

from __future__ import annotations

from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.synthetic.paths import Path

Floats = NDArray[np.float64]

_STEP = 0.2
"""Metres between the vertices of a line along the road."""

STRAIGHT_ARROW = np.array([
    [0.0, -0.08], [1.6, -0.08], [1.6, -0.35], [2.8, 0.0], [1.6, 0.35], [1.6, 0.08], [0.0, 0.08],
])
"""Outline (s, d) of an arrow ahead, metres."""
LEFT_ARROW = np.array([
    [0.0, -0.08], [1.83, -0.08], [1.83, 0.35], [2.25, 0.35], [1.75, 1.0], [1.25, 0.35],
    [1.67, 0.35], [1.67, 0.08], [0.0, 0.08],
])
"""Outline (s, d) of an arrow to the left, metres."""


def strip(road: Path, start: float, end: float, d: float, width: float) -> Floats:
    """Return the outline (n, 2) of a band along the road from arc `start` to `end`."""
    arcs = np.linspace(start, end, max(2, math.ceil((end - start) / _STEP) + 1))
    left, right = road.beside(arcs, d + width / 2), road.beside(arcs, d - width / 2)
    return np.vstack([left, right[::-1]])


def solid_line(road: Path, d: float, width: float = 0.12) -> list[Floats]:
    """Return a line all along the road, in pieces of a few metres."""
    edges = np.linspace(0.0, road.length, math.ceil(road.length / 4.0) + 1)
    return [strip(road, a, b, d, width) for a, b in pairwise(edges.tolist())]


def dashed_line(
    road: Path, d: float, *, dash: float = 3.0, gap: float = 3.0, width: float = 0.12
) -> list[Floats]:
    """Return dashes all along the road; the period is fitted to the road's length."""
    count = round(road.length / (dash + gap))
    starts = np.arange(count) * road.length / count
    return [strip(road, float(s), float(s) + dash, d, width) for s in starts]


def crosswalk(road: Path, start: float, half_width: float, depth: float = 3.0) -> list[Floats]:
    """Return the bars of a crosswalk that begins at arc `start`."""
    centres = np.arange(-half_width + 0.45, half_width - 0.2, 1.0)
    return [strip(road, start, start + depth, float(d), 0.5) for d in centres]


def stop_line(road: Path, start: float, low: float, high: float) -> list[Floats]:
    """Return a bar of 0.4 m across the lane between d = low and high."""
    return [strip(road, start, start + 0.4, 0.5 * (low + high), high - low)]


def symbol(road: Path, outline: Floats, start: float, d: float, *, flip: bool = False) -> Floats:
    """Return an (s, d) outline laid on the road; `flip` turns it for oncoming traffic."""
    shape = -outline if flip else outline
    return road.beside(start + shape[:, 0], d + shape[:, 1])


def parking_bays(road: Path, start: float, count: int, d: float) -> list[Floats]:
    """Return the marks between parking bays of 5.5 m beside the lane, at d inwards."""
    arcs = start + 5.5 * np.arange(count + 1)
    marks = [strip(road, float(s), float(s) + 0.1, d, 2.0) for s in arcs]
    return [*marks, strip(road, float(arcs[0]), float(arcs[-1]) + 0.1, d + 1.0, 0.1)]
