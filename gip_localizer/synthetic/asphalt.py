# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Surfaces without paint: asphalt grain, patches, cracks, tar seams and manholes.

Sizes are in metres and shades are reflectances in [0, 1]. All of them are chosen so that rendered
frames resemble photographs of worn roads; none of them is measured.

"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gip_localizer.synthetic.canvas import Canvas, paint, rectangle
from gip_localizer.synthetic.texture import octaves

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

ASPHALT = 0.30
"""Mean reflectance of worn asphalt, in [0, 1]; chosen."""
GRAINS = ((0.012, 0.035), (0.05, 0.018), (0.15, 0.012), (0.5, 0.012), (2.0, 0.016), (8.0, 0.02))
"""Noise octaves of asphalt: (grain size in metres, standard deviation of reflectance); chosen."""
VERGE_GRAINS = ((0.03, 0.04), (0.1, 0.04), (0.3, 0.03), (1.2, 0.03), (5.0, 0.03))
"""Noise octaves of the grass and gravel next to the road, in the units of `GRAINS`; chosen."""


def asphalt(canvas: Canvas, rng: np.random.Generator, mean: float = ASPHALT) -> Floats32:
    """Return an asphalt surface, (rows, cols) reflectance."""
    return np.asarray(mean + octaves(canvas.shape, canvas.resolution, GRAINS, rng), np.float32)


def verge(canvas: Canvas, rng: np.random.Generator, mean: float = 0.24) -> Floats32:
    """Return the surface next to the road, (rows, cols) reflectance."""
    grains = octaves(canvas.shape, canvas.resolution, VERGE_GRAINS, rng)
    return np.asarray(mean + grains, np.float32)


def add_patches(
    grey: Floats32, canvas: Canvas, places: Floats, yaws: Floats, rng: np.random.Generator
) -> None:
    """Draw repaired rectangles with sealed edges at positions (n, 2) in metres, in place."""
    for (x, y), yaw in zip(places.tolist(), yaws.tolist(), strict=True):
        size = float(rng.uniform(0.7, 3.0)), float(rng.uniform(0.6, 1.8))
        outline = rectangle((x, y), size, yaw)
        shade = rng.choice([-1.0, 1.0]) * rng.uniform(0.035, 0.09)
        fill = canvas.polygons([outline])
        grey += fill * np.float32(shade)
        seam = canvas.lines([np.vstack([outline, outline[:1]])], 0.05)
        paint(grey, seam * np.float32(0.75), 0.12)


def add_cracks(
    grey: Floats32, canvas: Canvas, places: Floats, yaws: Floats, rng: np.random.Generator
) -> None:
    """Draw cracks from places (n, 2) along yaws (n,), in place; some are sealed with tar."""
    for start, yaw in zip(places, yaws.tolist(), strict=True):
        path = _wander(start, yaw, rng)
        tarred = rng.random() < 0.3
        width = float(rng.uniform(0.05, 0.09) if tarred else rng.uniform(0.012, 0.03))
        paint(grey, canvas.lines([path], width) * np.float32(0.85), 0.09)
        if not tarred:
            branch = _wander(path[len(path) // 2], yaw + rng.uniform(0.5, 1.2), rng)
            paint(grey, canvas.lines([branch], 0.012) * np.float32(0.8), 0.1)


def _wander(start: Floats, yaw: float, rng: np.random.Generator) -> Floats:
    """Return the points (n, 2) of a crack: a random walk whose mean heading is `yaw`."""
    count = int(rng.integers(12, 45))
    headings = yaw + np.cumsum(rng.normal(0.0, 0.25, count)) * 0.5
    steps = rng.uniform(0.06, 0.18, count)[:, None]
    moves = steps * np.column_stack([np.cos(headings), np.sin(headings)])
    return np.vstack([start, start + np.cumsum(moves, axis=0)])


def add_manholes(grey: Floats32, canvas: Canvas, places: Floats) -> None:
    """Draw iron covers with a bright ring and a grid pattern at places (n, 2), in place."""
    size = len(places)
    paint(grey, canvas.discs(places, np.full(size, 0.42)), 0.2)
    paint(grey, canvas.discs(places, np.full(size, 0.36)), 0.38)
    paint(grey, canvas.discs(places, np.full(size, 0.31)), 0.14)
    for x, y in places.tolist():
        steps = np.linspace(-0.2, 0.2, 4)
        bars = [np.array([[x - 0.2, y + d], [x + 0.2, y + d]]) for d in steps]
        bars += [np.array([[x + d, y - 0.2], [x + d, y + 0.2]]) for d in steps]
        paint(grey, canvas.lines(bars, 0.035), 0.3)


def add_stains(grey: Floats32, canvas: Canvas, places: Floats, rng: np.random.Generator) -> None:
    """Draw oil stains at places (n, 2), in place."""
    for place in places:
        spots = place + rng.normal(0.0, 0.15, (5, 2))
        mask = canvas.discs(spots, rng.uniform(0.03, 0.14, 5))
        paint(grey, mask * np.float32(rng.uniform(0.3, 0.7)), 0.15)
