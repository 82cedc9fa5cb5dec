# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Standard deviation of the grey of map cells, estimated from the sums that form the map."""

from __future__ import annotations

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye.rectifier import View

KINDS = 5
"""Number of sums per cell: as many as the indices below."""
G, GV, GVV, GG, GS = range(KINDS)
"""Indices of the sums over frames: G, G·grey, G·grey², G² and G·spill, with the weight G."""
PRIOR_FRAMES = 4.0
"""Number of frames for which the scatter of the whole map counts in each cell; chosen."""
SUBCELL = 4.0
"""
Squared ratio (no unit) of the contrast across a side of a cell to that of neighbouring cells.

From a measurement on rendered roads, which no command in the tree repeats.

"""


def spill(view: View, resolution: float) -> Floats:
    """
    Fraction (rows, cols) of a map cell's grey that comes from across each of its four sides.

    The position of a road point in the map has three uniform errors: the width of a view cell,
    twice (cutting and drawing), and the width of a pixel. With their total standard deviation s,
    `E|x|/2 = 0.4 s` crosses a side.

    """
    pixel_sq = view.grid.resolution**2 / np.maximum(view.footprint, 1e-6)  # m² of road
    return np.asarray(0.4 * np.sqrt(view.grid.resolution**2 / 6.0 + pixel_sq / 12.0) / resolution)


def cell_noise(sums: Floats, valid: Bools) -> Floats:
    """
    Standard deviation of each cell's grey.

    - Different between frames: `Σ G (v - mean)² / (n - 1)` over `Σ G`, with the effective number
      of frames n = (Σ G)²/Σ G². Few frames give a poor estimate of a variance, so the scatter of
      the whole map counts as `PRIOR_FRAMES` more. The result is never below that of pixel noise
      alone, `1/√Σ G`.
    - Equal in all frames: grey that spills over from the neighbouring cells.

    """
    total = np.maximum(sums[G], 1e-30)
    frames = total**2 / np.maximum(sums[GG], 1e-30)
    scatter = np.maximum(sums[GVV] - sums[GV]**2 / total, 0.0)
    often = valid & (frames > 2.0)
    usual = float(np.median(scatter[often] / (frames[often] - 1.0))) if often.any() else 1.0
    factor = (scatter + PRIOR_FRAMES * usual) / (np.maximum(frames - 1.0, 0.0) + PRIOR_FRAMES)
    spilt = SUBCELL * (sums[GS] / total)**2 * _contrast_sq(sums[GV] / total, valid)
    return np.asarray(np.sqrt(np.maximum(factor, 1.0) / total + spilt))


def _contrast_sq(grey: Floats, valid: Bools) -> Floats:
    """Sum (rows, cols) of squared differences to the four neighbours, at least the local mean."""
    sums = np.zeros_like(grey)
    for axis in (0, 1):
        step = np.diff(grey, axis=axis)**2
        both = np.logical_and(*(np.take(valid, np.arange(step.shape[axis]) + k, axis)
                                for k in (0, 1)))
        step[~both] = 0.0
        pad = [(0, 0), (0, 0)]
        for pad[axis] in ((0, 1), (1, 0)):
            sums += np.pad(step, pad)
    share = np.maximum(cv2.blur(valid.astype(np.float64), (3, 3)), 0.1)
    return np.maximum(sums, cv2.blur(sums, (3, 3)) / share)
