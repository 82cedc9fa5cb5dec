# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Cells of a map as arrays: their grey as numbers, averaged, smoothed, halved."""

from __future__ import annotations

from functools import cache
import math

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey, WHITE
from gip_localizer.core.cell_means import downsampled

# Weights (1/cell) of four neighbouring cells in the slope along the columns.
SLOPE_RIGHT = np.array([[-0.5, 0.5], [-0.5, 0.5]], np.float32)
# Least share of known cells (no unit) of a larger known cell: 1, less rounding.
WHOLE = 0.999
# Largest number of cells from which the contrast of a map is estimated (design choice: 100,000,
# because the error is then below 1 %).
SAMPLED = 100_000
# Number of cells on either side that influence the spline between two cells: the influence
# decreases by 0.27 per cell, and 0.27 to the 5th power is 1e-3.
REACH = 5


def all_finite(values: Grey) -> bool:
    """Whether an array holds neither NaN nor infinity."""
    if values.dtype.kind != 'f':
        return True
    return bool(np.isfinite(values.min()) and np.isfinite(values.max()))


def on_unit_scale(grey: Grey) -> Floats:
    """Grey on its full scale, (rows, cols) float32 in [0, 1]."""
    return np.asarray(np.asarray(grey, np.float32) / np.float32(WHITE[grey.dtype]))


def slopes(values: Floats) -> tuple[Floats, Floats]:
    """Slopes (rows, cols) float32 down and right, in the middle of each cell and the next ones."""
    down, right = (
        cv2.filter2D(values, cv2.CV_32F, kernel, anchor=(0, 0), borderType=cv2.BORDER_REPLICATE)
        for kernel in (np.ascontiguousarray(SLOPE_RIGHT.T), SLOPE_RIGHT)
    )
    return np.asarray(down), np.asarray(right)


def downsampled_known(
    values: Floats, valid: Bools | None, step: int
) -> tuple[Floats, Bools | None]:
    """Average step x step cells into one; it is valid where all of them are."""
    shape = values.shape[0] // step, values.shape[1] // step
    means = downsampled(values, step, shape)
    if valid is None:
        return means, None
    return means, downsampled(valid.astype(np.float32), step, shape) > WHOLE


def contrast(grey: Grey, valid: Bools | None) -> float:
    """Standard deviation of the grey ([0, 1]) of known cells, from about `SAMPLED` of them."""
    step = max(int(math.sqrt(grey.size / SAMPLED)), 1)
    values = on_unit_scale(grey[::step, ::step])
    if valid is not None:
        values = values[valid[::step, ::step]]
    return float(values.std()) if values.size else 0.0


def averaged_noise(noise: Grey, step: int, ratio: float) -> Floats:
    """Noise (float32) of means over `step` and then `ratio` cells a side that err on their own."""
    sigma = on_unit_scale(noise)
    if step > 1:
        shape = noise.shape[0] // step, noise.shape[1] // step
        squares = downsampled(sigma**2, step, shape)
        sigma = np.asarray(np.sqrt(squares) / np.float32(step))
    return np.asarray(sigma / np.float32(max(ratio, 1.0)))


def repeated(cells: Grey) -> Grey:
    """Twice the rows and columns."""
    return np.repeat(np.repeat(cells, 2, axis=0), 2, axis=1)


def smoothed(
    values: Floats, valid: Bools | None, ratio: float, before: float = 1.0
) -> tuple[Floats, Bools | None]:
    """Smooth so that bilinear sampling has the second moment of a box of `ratio` cells."""
    if ratio <= 1.05 * before:
        return values, valid
    return blurred(values, valid, math.sqrt((ratio**2 - before**2) / 12.0))


def blurred(values: Floats, valid: Bools | None, sigma: float) -> tuple[Floats, Bools | None]:
    """Blur known cells by a Gaussian, in cells."""
    if valid is None:
        return cv2.GaussianBlur(values, (0, 0), sigma).astype(np.float32), None
    share = cv2.GaussianBlur(valid.astype(np.float32), (0, 0), sigma)
    known = cv2.GaussianBlur(np.where(valid, values, np.float32(0.0)), (0, 0), sigma)
    return (known / np.maximum(share, 1e-6)).astype(np.float32), valid & (share > 0.5)


@cache
def _quarter() -> Floats:
    """
    Weights of 2 REACH + 1 cells in the cubic spline a quarter of a cell before their middle.

    Between two cells the natural spline is `(1-t) y₀ + t y₁ + ((1-t)³-(1-t)) M₀/6 + (t³-t) M₁/6`.
    Its second derivatives M are those with which the slopes agree at the cells. SciPy's
    CubicSpline gives the same; its import would take half a second of the first frame.

    """
    cells = np.eye(2 * REACH + 1)
    inner = cells[1:-1]
    equations = 4.0 * inner[:, 1:-1] + inner[:, 2:] + inner[:, :-2]
    second = np.zeros_like(cells)
    second[1:-1] = np.linalg.solve(equations, 6.0 * (cells[2:] - 2.0 * inner + cells[:-2]))
    before, middle, t = REACH - 1, REACH, 0.75
    weights = (1.0 - t) * cells[before] + t * cells[middle] + (
        ((1.0 - t) ** 3 - (1.0 - t)) * second[before] + (t**3 - t) * second[middle]
    ) / 6.0
    return np.asarray(weights, np.float32)


def doubled(values: Floats) -> Floats:
    """
    Twice the rows and columns, by cubic splines through the cells.

    What an interpolation blurs between cell centres and not at them draws a match towards these.
    Over roads along the map's axes the pull of cubic convolution is 0.9 mm on cells of 5 cm, that
    of splines 0.2 mm.

    """
    out = np.empty((2 * values.shape[0], 2 * values.shape[1]), np.float32)
    before, after = _quarter(), np.ascontiguousarray(_quarter()[::-1])
    for i, down in enumerate((before, after)):
        for k, right in enumerate((before, after)):
            out[i::2, k::2] = cv2.sepFilter2D(
                values, cv2.CV_32F, right, down, borderType=cv2.BORDER_REPLICATE
            )
    return out
