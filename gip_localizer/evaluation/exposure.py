# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Gain and offset of a frame against what the map already holds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats, median

LEAST_CELLS = 20
LEAST_CORRELATION = 0.5  # squared; below, the road has too little contrast to tell a gain
PASSES = 5
OUTLIER = 3.0  # robust standard deviations


class Exposure(NamedTuple):
    """A frame shows `gain · map + offset`, grey levels of [0, 1]."""

    gain: float = 1.0
    offset: float = 0.0


def fit_exposure(
    value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats], last: Exposure
) -> Exposure | None:
    """
    Fit a line through cells that both know, errors in both (Deming), outliers left out.

    An ordinary fit would take the noise of the map for contrast and find every gain too small,
    so that the map's contrast drifts along the drive.

    Parameters
    ----------
    value, reference : (n,) float64
        Grey of the frame and of the map.
    noise_sq : two of (n,) float64
        Their variances.
    last : Exposure
        Its gain is kept where the road has too little contrast to tell.

    Returns
    -------
    Exposure or None
        None: too few cells.

    """
    if len(value) < LEAST_CELLS:
        return None
    found, beyond = last, 0.0
    kept = np.ones(len(value), bool)
    for _ in range(PASSES):
        found = _line(value, reference, noise_sq, (beyond, kept), last)
        residual = value - found.gain * reference - found.offset
        spread = 1.4826 * median(np.abs(residual))
        kept = np.abs(residual) <= OUTLIER * max(spread, 1e-6)
        beyond = 0.5 * max(spread**2 - float(np.median(noise_sq[0] + noise_sq[1])), 0.0)
    return found


def _line(value: Floats, reference: Floats, noise_sq: tuple[Floats, Floats],
          trust: tuple[float, Floats], last: Exposure) -> Exposure:
    """Weighted Deming fit; both err by some variance beyond their noise."""
    beyond, kept = trust
    in_value, in_reference = noise_sq[0][kept] + beyond, noise_sq[1][kept] + beyond
    v, m = value[kept], reference[kept]
    share = 1.0 / (noise_sq[0][kept] + noise_sq[1][kept])  # near, sharp views decide
    share /= share.sum()
    mean_v, mean_m = float(share @ v), float(share @ m)
    vv, mm = float(share @ (v - mean_v) ** 2), float(share @ (m - mean_m) ** 2)
    vm = float(share @ ((v - mean_v) * (m - mean_m)))
    gain = last.gain
    if vm > 0.0 and vm**2 > LEAST_CORRELATION * vv * mm:
        ratio = float(share @ in_value) / max(float(share @ in_reference), 1e-30)
        excess = vv - ratio * mm
        gain = (excess + math.sqrt(excess**2 + 4.0 * ratio * vm**2)) / (2.0 * vm)
    return Exposure(gain, mean_v - gain * mean_m)
