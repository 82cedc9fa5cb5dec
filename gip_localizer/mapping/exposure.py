# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Gain and offset of a frame against what the map already holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, median

LEAST_CELLS = 20
LEAST_CORRELATION = 0.5  # squared; below, the road has too little contrast to tell a gain
CONTRAST = 0.02  # of a gain told by contrast: its error where all else fits
BLACK = 0.05  # grey that cameras and stray light usually add
PASSES = 5
OUTLIER = 3.0  # robust standard deviations


class Exposure(NamedTuple):
    """A frame shows `gain · map + offset`, grey levels of [0, 1]."""

    gain: float = 1.0
    offset: float = 0.0


def fit_exposure(
    value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats]
) -> Exposure | None:
    """
    Fit a line through cells that both know, errors in both (Deming), outliers left out.

    An ordinary fit would take the noise of the map for contrast and find every gain too small.
    Where frame and map lie askew (the vehicle pitches), the map has less contrast than any frame,
    and gains told by contrast would grow from frame to frame. So the ratio of brightness tells a
    gain too, good to what black level and stray light may add, and counts the more the worse
    frame and map agree.

    Parameters
    ----------
    value, reference : (n,) float64
        Grey of the frame and of the map.
    noise_sq : two of (n,) float64
        Their variances.

    Returns
    -------
    Exposure or None
        None: too few cells.

    """
    if len(value) < LEAST_CELLS:
        return None
    found, beyond = Exposure(), 0.0
    kept = np.ones(len(value), bool)
    for _ in range(PASSES):
        found = _line(value, reference, noise_sq, (beyond, kept))
        residual = value - found.gain * reference - found.offset
        spread = 1.4826 * median(np.abs(residual))
        kept = np.abs(residual) <= OUTLIER * max(spread, 1e-6)
        beyond = 0.5 * max(spread**2 - float(np.median(noise_sq[0] + noise_sq[1])), 0.0)
    return found


def _line(value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats],
          trust: tuple[float, Bools]) -> Exposure:
    """Weighted Deming fit; both err by some variance beyond their noise."""
    beyond, kept = trust
    share = 1.0 / (noise_sq[0][kept] + noise_sq[1][kept])  # near, sharp views decide
    share /= share.sum()
    mean_v, mean_m, in_v, in_m = (
        float(share @ part[kept]) for part in (value, reference, *noise_sq)
    )
    v, m = value[kept] - mean_v, reference[kept] - mean_m
    vv, mm, vm = (float(share @ square) for square in (v * v, m * m, v * m))
    bright = max(mean_v, 1e-3) / max(mean_m, 1e-3)
    if not (vm > 0.0 and vm**2 > LEAST_CORRELATION * vv * mm):
        return Exposure(bright, mean_v - bright * mean_m)
    ratio = (in_v + beyond) / max(in_m + beyond, 1e-30)
    excess = vv - ratio * mm
    gain = (excess + math.sqrt(excess**2 + 4.0 * ratio * vm**2)) / (2.0 * vm)
    askew = max(float(share @ (v - gain * m)**2) - in_v - gain**2 * in_m, 0.0) / vv
    by_contrast, by_brightness = CONTRAST + askew, BLACK / max(mean_m, 1e-3)
    part = by_brightness**2 / (by_brightness**2 + by_contrast**2)
    gain = part * gain + (1.0 - part) * bright
    return Exposure(gain, mean_v - gain * mean_m)
