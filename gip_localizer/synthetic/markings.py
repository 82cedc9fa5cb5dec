# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Road paint as outlines in metres: lane lines, stop lines, crosswalks and arrows.

Positions are (s, d): arc length along the centre line and offset to its left, both in metres.
Traffic keeps right, so the lane in driving direction lies at d < 0. All sizes are in metres and
are chosen; they resemble European road markings.

"""

from __future__ import annotations

from itertools import pairwise
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.synthetic.paths import Path

Floats = NDArray[np.float64]

_STEP = 0.2
"""Distance between the vertices of a line along the road, metres; chosen."""

STRAIGHT_ARROW = np.array([
    [0.0, -0.08], [1.6, -0.08], [1.6, -0.35], [2.8, 0.0], [1.6, 0.35], [1.6, 0.08], [0.0, 0.08],
])
"""Outline (s, d) of a straight arrow, metres; chosen."""
LEFT_ARROW = np.array([
    [0.0, -0.08], [1.83, -0.08], [1.83, 0.35], [2.25, 0.35], [1.75, 1.0], [1.25, 0.35],
    [1.67, 0.35], [1.67, 0.08], [0.0, 0.08],
])
"""Outline (s, d) of a left-turn arrow, metres; chosen."""


def strip(road: Path, start: float, end: float, d: float, width: float) -> Floats:
    """Return the outline (n, 2) of a band along the road from arc `start` to `end`."""
    arcs = np.linspace(start, end, max(2, math.ceil((end - start) / _STEP) + 1))
    left = road.offset_positions(arcs, d + width / 2)
    right = road.offset_positions(arcs, d - width / 2)
    return np.vstack([left, right[::-1]])


def solid_line(road: Path, d: float, width: float = 0.12) -> list[Floats]:
    """Return a line along the whole road, in pieces of a few metres."""
    edges = np.linspace(0.0, road.length, math.ceil(road.length / 4.0) + 1)
    return [strip(road, a, b, d, width) for a, b in pairwise(edges.tolist())]


def dashed_line(
    road: Path, d: float, *, dash: float = 3.0, gap: float = 3.0, width: float = 0.12
) -> list[Floats]:
    """Return dashes along the whole road; the period divides the length of the road."""
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
    """Return an (s, d) outline placed on the road; `flip` rotates it for oncoming traffic."""
    shape = -outline if flip else outline
    return road.offset_positions(start + shape[:, 0], d + shape[:, 1])


def parking_bays(road: Path, start: float, count: int, d: float) -> list[Floats]:
    """Return the lines between parking bays of 5.5 m next to the lane, from d towards the lane."""
    arcs = start + 5.5 * np.arange(count + 1)
    marks = [strip(road, float(s), float(s) + 0.1, d, 2.0) for s in arcs]
    return [*marks, strip(road, float(arcs[0]), float(arcs[-1]) + 0.1, d + 1.0, 0.1)]
