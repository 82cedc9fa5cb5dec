# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the grey of a map's cells may be off, told by the sums that the map is made of."""

from __future__ import annotations

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye.rectifier import View

KINDS = 5
G, GV, GVV, GG, GS = range(KINDS)
"""Sums over frames: weight, times grey, times grey², weight², weight times spill."""
PRIOR_FRAMES = 4.0  # frames that the disagreement all over the map counts for in each cell
SUBCELL = 4.0  # contrast across a side over that of the cells beside it, squared (measured)


def spill(view: View, resolution: float) -> Floats:
    """
    Share (rows, cols) of a map cell's grey that comes from beyond each of its four sides.

    A point of road lands off its place by the width of a view cell, twice (cut and drawn), and
    of a pixel: with the standard deviation s in all, `E|x|/2 = 0.4 s` crosses a side.

    """
    pixel_sq = view.grid.resolution**2 / np.maximum(view.footprint, 1e-6)  # m² of road
    return np.asarray(0.4 * np.sqrt(view.grid.resolution**2 / 6.0 + pixel_sq / 12.0) / resolution)


def cell_noise(sums: Floats, valid: Bools) -> Floats:
    """
    Standard deviation of each cell's grey.

    - Between frames: `Σ G (v - mean)² / (n - 1)` over `Σ G`, n the effective number of frames
      (Σ G)²/Σ G². Few frames tell a variance badly, so what all cells say counts for some frames
      more. Never below what pixel noise alone leaves, `1/√Σ G`.
    - In all frames alike: what spills over from the cells beside.

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
    """Sum (rows, cols) of squared differences to the four cells beside, as usual around there."""
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
