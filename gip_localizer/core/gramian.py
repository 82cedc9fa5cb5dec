# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 2: footprint areas → weight of every cell, the diagonal Gramian.

In the paper, the mean of a cell has the noise variance `σ² = N0/Ã`, so the maximum-likelihood norm
weights it by `G ∝ Ã` (Gramian, OptimalClassifier). A real map adds a variance that does not depend
on the footprint: `G = 1/(N0/Ã + σ_map²)`. The rule of the paper is the limit `σ_map → 0`.

"""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Floats

# Largest ratio (no unit) of the contrast of the whole map to that of the part in view (measured:
# on dim nights the mean NEES is 3.1 with 4 and 3.7 with 2, docs/accuracy.md).
MAX_CONTRAST_RATIO = 4.0
# Least standard deviation of a pixel (grey levels of [0, 1]): slightly below that of rounding to
# 8 bits, which is 0.29/255 (one over the square root of 12).
NOISE_FLOOR = 0.25 / 255.0


def gramian(footprint: Floats, *, pixel_noise: float, map_noise: float) -> Floats:
    """
    Return the weight of every cell.

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
    Return the largest possible gain of a view (contrast of the image over that of the map, <= 1).

    The part of the road in view may have less contrast than the whole map, at least a quarter of
    it; shadows and cars add contrast.

    Parameters
    ----------
    patch, footprint : (...) float32
        Means of the view, and Ã, px²; 0 where nothing is seen.
    pixel_noise : float
        Standard deviation of a pixel, grey levels of [0, 1].
    map_contrast : float
        Standard deviation of the grey of the map, grey levels of [0, 1].

    """
    total = float(footprint.sum(dtype=np.float64))
    if total <= 0.0 or map_contrast <= 0.0:
        return 1.0
    mean = np.float32(float((footprint * patch).sum(dtype=np.float64)) / total)
    spread = float((footprint * (patch - mean) ** 2).sum(dtype=np.float64)) / total
    noise = pixel_noise**2 * np.count_nonzero(footprint) / total
    return min(MAX_CONTRAST_RATIO * math.sqrt(max(spread - noise, 0.0)) / map_contrast, 1.0)
