# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Gain and offset of a frame relative to the map as built so far."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, upper_median

LEAST_CELLS = 20
"""Least number of common cells (or blocks) for a fit; chosen."""
LEAST_CORRELATION = 0.5
"""Least squared correlation for a gain from contrast; below it, contrast is too low; chosen."""
CONTRAST = 0.02
"""Relative error of a gain from contrast when frame and map agree; chosen."""
BLACK = 0.05
"""Grey, of [0, 1], that black level and stray light typically add to a frame; chosen."""
PASSES = 5
"""Number of iterations of the robust fit; chosen."""
OUTLIER = 3.0
"""Residual, in robust standard deviations, from which a cell is an outlier; chosen."""


class Exposure(NamedTuple):
    """Exposure of a frame: its grey is `gain · map + offset`, in [0, 1]."""

    gain: float = 1.0
    offset: float = 0.0


def fit_exposure(
    value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats]
) -> Exposure | None:
    """
    Fit a line through common cells, with errors in both variables (Deming) and without outliers.

    An ordinary least-squares fit would treat the noise of the map as contrast and underestimate
    every gain. Where frame and map are misaligned (the vehicle pitches), the map has less
    contrast than any frame, and gains from contrast would grow from frame to frame. Therefore the
    ratio of mean brightness gives a second estimate of the gain, whose error is what black level
    and stray light add. The worse frame and map agree, the larger is its weight.

    Parameters
    ----------
    value, reference : (n,) float64
        Grey of the frame and of the map.
    noise_sq : two of (n,) float64
        Variances of both.

    Returns
    -------
    Exposure or None
        None if there are too few cells.

    """
    if len(value) < LEAST_CELLS:
        return None
    found, beyond = Exposure(), 0.0
    kept = np.ones(len(value), bool)
    for _ in range(PASSES):
        found = _line(value, reference, noise_sq, (beyond, kept))
        residual = value - found.gain * reference - found.offset
        spread = 1.4826 * upper_median(np.abs(residual))
        kept = np.abs(residual) <= OUTLIER * max(spread, 1e-6)
        beyond = 0.5 * max(spread**2 - float(np.median(noise_sq[0] + noise_sq[1])), 0.0)
    return found


def _line(value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats],
          extra: tuple[float, Bools]) -> Exposure:
    """Weighted Deming fit; both variables have an additional variance beyond their noise."""
    beyond, kept = extra
    share = 1.0 / (noise_sq[0][kept] + noise_sq[1][kept])  # the nearer, sharper view dominates
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
    misfit = max(float(share @ (v - gain * m)**2) - in_v - gain**2 * in_m, 0.0) / vv
    by_contrast, by_brightness = CONTRAST + misfit, BLACK / max(mean_m, 1e-3)
    part = by_brightness**2 / (by_brightness**2 + by_contrast**2)
    gain = part * gain + (1.0 - part) * bright
    return Exposure(gain, mean_v - gain * mean_m)
