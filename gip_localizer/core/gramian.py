# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 2: footprint areas → weight of every cell, the diagonal Gramian.

The paper: a cell mean has noise variance `σ² = N0/Ã`, so the maximum-likelihood norm weights it
by `G ∝ Ã` (Gramian, OptimalClassifier). A real map adds variance that no footprint averages
away: `G = 1/(N0/Ã + σ_map²)`, with the paper's rule as the limit `σ_map → 0`.

"""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Floats

MOST_RATIO = 4.0  # of the contrast of the map to that of the part of it that a view shows
NOISE_FLOOR = 0.25 / 255.0  # grey levels of [0, 1]: rounding to 8 bits alone gives 0.29/255


def gramian(footprint: Floats, *, pixel_noise: float, map_noise: float) -> Floats:
    """
    Weight of every cell.

    Parameters
    ----------
    footprint : (...) float32
        Ã, px²; 0 marks cells without weight.
    pixel_noise : float
        Standard deviation of a pixel (√N0), grey levels of [0, 1].
    map_noise : float
        Standard deviation of the map in the view's grey levels; 0 gives the paper's rule.

    Returns
    -------
    (...) float32
        `1/(N0/Ã + σ_map²)`, one over grey levels squared; 0 where the footprint is 0.

    """
    noise = max(pixel_noise, NOISE_FLOOR) ** 2
    weights: Floats = (footprint / (noise + map_noise**2 * footprint)).astype(np.float32)
    return weights


def most_gain(
    patch: Floats, footprint: Floats, *, pixel_noise: float, map_contrast: float
) -> float:
    """
    Largest gain (contrast of the image over that of the map, at most 1) that a view may have.

    A part of the road may have less contrast than the map altogether, a quarter at least; shadows
    and cars add to it.

    Parameters
    ----------
    patch, footprint : (...) float32
        The view, and Ã, px²; 0 where nothing is seen.
    pixel_noise : float
        Standard deviation of a pixel, grey levels of [0, 1].
    map_contrast : float
        Standard deviation of the map's grey.

    """
    total = float(footprint.sum(dtype=np.float64))
    if total <= 0.0 or map_contrast <= 0.0:
        return 1.0
    mean = np.float32(float((footprint * patch).sum(dtype=np.float64)) / total)
    spread = float((footprint * (patch - mean) ** 2).sum(dtype=np.float64)) / total
    noise = pixel_noise**2 * np.count_nonzero(footprint) / total
    return min(MOST_RATIO * math.sqrt(max(spread - noise, 0.0)) / map_contrast, 1.0)
