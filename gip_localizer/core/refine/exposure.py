# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Exposure of a view relative to the map: gain, offset, and how the gain varies over the image."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats

# Ridge of the shading factors, as a share of the information on the gain (no unit; design choice:
# 1e-3, because a view without pattern at its border must not give a large factor).
SHADING_RIDGE = 1e-3
# Largest shading factor (no unit; design choice: 0.5, because lenses darken the border by at most
# half).
MAX_SHADING = 0.5


def exposure(
    values: Floats, predicted: Floats, weights: Floats, *, least_gain: float
) -> tuple[float, float]:
    """Return gain and offset of the view relative to the map, by weighted least squares."""
    total = float(weights.sum())
    if total <= 0.0:
        return 1.0, 0.0
    mean_v, mean_m = float(weights @ values) / total, float(weights @ predicted) / total
    centred = weights * (predicted - np.float32(mean_m))
    gain = float(centred @ values) / max(float(centred @ predicted), 1e-12)
    gain = max(gain, least_gain)
    return gain, mean_v - gain * mean_m


def shading(values: Floats, predicted: Floats, weights: Floats, basis: Floats) -> Floats:
    """
    Estimate the variation of the gain over the image (vignetting, a dirty lens) in a basis.

    Parameters
    ----------
    values, predicted, weights : (n,) float32
        View, map behind the pixel blur, and weights.
    basis : (k, n) float32
        Smooth functions of the pixel, of order one.

    Returns
    -------
    (k,) float64
        Factors c of `v = a (1 + basis c) m + b`, shrunk towards zero.

    """
    columns = np.concatenate([[predicted, np.ones_like(predicted)], basis * predicted])
    weighted = columns * weights
    normal = (weighted @ columns.T).astype(np.float64)
    ridge = np.zeros(len(normal))
    ridge[2:] = SHADING_RIDGE * normal[0, 0]
    solved = np.linalg.solve(
        normal + np.diag(ridge + 1e-12), (weighted @ values).astype(np.float64)
    )
    if solved[0] <= 0.0:
        return np.zeros(len(basis))
    return np.clip(solved[2:] / solved[0], -MAX_SHADING, MAX_SHADING)
