# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Changes of a road after mapping: new asphalt, litter, worn paint.

Sizes (metres) and reflectances are chosen.

"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import WHITE
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.synthetic.asphalt import asphalt
from gip_localizer.synthetic.canvas import Canvas, paint, rectangle
from gip_localizer.synthetic.texture import smooth_step, value_noise

PAINTED = (0.42, 0.52)
"""Reflectances (0 to 1) from which ground counts as paint in part, and in full; chosen."""
Floats32 = NDArray[np.float32]
Bools = NDArray[np.bool_]


def changed(world: RasterMap, share: float, *, seed: int) -> RasterMap:
    """
    Return the world as it looks some years later.

    Parameters
    ----------
    world : RasterMap
        The world at the time of mapping.
    share : float
        Fraction of the area that changes: half of it by new asphalt, half by worn paint and
        litter, in patches with sides of 1 to 4 m.
    seed : int
        Same seed, same changes.

    Returns
    -------
    RasterMap
        float32, same grid.

    """
    rng = np.random.default_rng([seed, 2])
    scale = np.float32(WHITE[world.grey.dtype])
    grey = np.asarray(world.grey, np.float32) / scale
    canvas = Canvas((grey.shape[0], grey.shape[1]), world.resolution)
    level = float(np.median(grey))
    repaired = _spots(canvas, 0.5 * share, rng)
    worn = _spots(canvas, 0.5 * share, rng)
    paint(grey, worn, _worn(grey, canvas, rng))
    paint(grey, repaired, asphalt(canvas, rng, max(0.85 * level, 0.1)))
    _litter(grey, canvas, worn > 0.5, rng)
    return replace(world, grey=np.clip(grey, 0.0, 1.0).astype(np.float32))


def relaid(world: RasterMap, share: float, *, seed: int) -> RasterMap:
    """
    Return the world with new asphalt on a share of its area, and its paint where it was.

    Parameters
    ----------
    world : RasterMap
        As it was mapped.
    share : float
        Share of the area, in patches of one to four metres.
    seed : int
        Same seed, same patches.

    Returns
    -------
    RasterMap
        float32, same grid.

    """
    rng = np.random.default_rng([seed, 3])
    grey = np.asarray(world.grey, np.float32) / np.float32(WHITE[world.grey.dtype])
    canvas = Canvas((grey.shape[0], grey.shape[1]), world.resolution)
    unpainted = np.float32(1.0) - smooth_step(grey, PAINTED[0], PAINTED[1])
    spots = _spots(canvas, share, rng) * unpainted
    paint(grey, spots, asphalt(canvas, rng, max(0.85 * float(np.median(grey)), 0.1)))
    return replace(world, grey=np.clip(grey, 0.0, 1.0).astype(np.float32))


def _spots(canvas: Canvas, share: float, rng: np.random.Generator) -> Floats32:
    """Return the coverage of random rectangles that together cover a fraction of the canvas."""
    width, height = canvas.size
    coverage = np.zeros(canvas.shape, np.float32)
    while float(coverage.mean()) < share:
        missing = (share - float(coverage.mean())) * width * height
        outlines = []
        for _ in range(max(1, int(missing / 6.25))):
            centre = float(rng.uniform(0.0, width)), float(rng.uniform(0.0, height))
            size = float(rng.uniform(1.0, 4.0)), float(rng.uniform(1.0, 4.0))
            outlines.append(rectangle(centre, size, float(rng.uniform(0.0, np.pi))))
        coverage = np.maximum(coverage, canvas.polygons(outlines))
    return coverage


def _worn(grey: Floats32, canvas: Canvas, rng: np.random.Generator) -> Floats32:
    """Return the surface with worn paint: cells brighter than their surroundings get darker."""
    around = cv2.blur(grey, (max(3, round(2.0 / canvas.resolution)) | 1,) * 2)
    noise = value_noise(canvas.shape, canvas.resolution, 0.12, rng)
    rubbed = 0.35 + 0.6 * smooth_step(noise, -1.0, 1.0)
    return np.asarray(grey - rubbed * np.maximum(grey - around, 0.0), np.float32)


def _litter(grey: Floats32, canvas: Canvas, where: Bools, rng: np.random.Generator) -> None:
    """Scatter leaves, paper and dirt over cells, three pieces per square metre, in place."""
    area = float(where.sum()) * canvas.resolution**2
    for value in (0.12, 0.55, 0.85):
        rows, cols = np.nonzero(where)
        if not len(rows):
            return
        picks = rng.integers(0, len(rows), round(area))
        xy = np.column_stack([cols[picks] + 0.5, canvas.shape[0] - 0.5 - rows[picks]])
        radii = rng.uniform(0.015, 0.06, len(picks))
        paint(grey, canvas.discs(xy * canvas.resolution, radii) * np.float32(0.9), value)
