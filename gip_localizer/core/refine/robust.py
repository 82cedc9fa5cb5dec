# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Outliers: the noise level of the residuals, and cells and blocks that disagree with the map."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.refine.blocks import Blocks

# Quantile of the squared residuals from which the noise is estimated (design choice: one third,
# because up to two thirds of the cells may then be outliers).
TRIMMED = 1.0 / 3.0
# The same quantile of the chi-square distribution with 1 degree of freedom (no unit).
TRIMMED_CHI_SQ = 0.1855
# Quantile of the blocks' correlations with which each block is compared (design choice: 0.8,
# because cars may hide most blocks, and chance must not set the standard).
BETTER_BLOCKS = 0.8
# Least share of the weight in blocks whose pattern exceeds the noise (design choice: 0.02, because
# a decision from fewer blocks may be by chance).
LEAST_INFORMATIVE = 0.02
# Least weighted standard deviation (grey levels of [0, 1]) of a map with a pattern (design choice:
# 5e-4, an eighth of a grey level of 8 bits, because less is rounding).
LEAST_PATTERN = 5e-4
# Least expected correlation of a block whose measured correlation is used (design choice: 0.35,
# because below it the measured correlation is mostly noise).
LEAST_EXPECTED = 0.35
# Number of standard deviations above which residuals lose weight, for each value of `SPREADS`
# (measured: 3 instead of 6 where all is noise increases the error over tiles by 5 %, and 6 instead
# of 3 that behind cars by 4 %, docs/accuracy.md).
OUTLIERS = (3.0, 6.0, 6.0, 3.0)
# Ratios of the residuals' mean square to the assumed noise variance (no unit; design choice: above
# 1.15 outliers are likely, and from 1.5 on they are certain).
SPREADS = (0.25, 1.0, 1.15, 1.5)


def agreeing(
    values: Floats, predicted: Floats, weights: Floats, blocks: Blocks, *,
    gain: float | None = None,
) -> tuple[Floats, float]:
    """
    Return 1 for cells in blocks of road whose pattern agrees with the map, else 0, (n,) float32.

    The second value is the share of the weight in these blocks, among all blocks whose pattern
    exceeds the noise; 0 where no pattern exceeds it.

    Brightness and contrast of a block have no influence, so that cars, glare and patches are
    detected before the exposure is known. A block is kept if its correlation is at least half of
    the correlation expected with the noise; without a gain, half of that of the better blocks.

    """
    alike, var_m, total = _block_correlations(values, predicted, weights, blocks)
    w = np.maximum(total, 1e-20)
    counted = total > 0.0
    if not counted.any():
        return np.ones(len(values), np.float32), 0.0
    if gain is None:
        expected = np.full(len(w), _quantile(alike[counted], BETTER_BLOCKS))
        informative, kept = counted, alike >= 0.5 * expected
    else:
        cells = blocks.larger_sums((weights > 0.0).astype(np.int32))
        pattern = gain**2 * var_m
        expected = np.sqrt(pattern / (pattern + np.maximum(cells, 1) / w))
        informative = counted & (expected >= LEAST_EXPECTED) & (var_m > LEAST_PATTERN**2)
        kept = (alike >= 0.5 * expected) | ~informative
    least = LEAST_INFORMATIVE * w.sum()
    share = float(w[informative & kept].sum() / max(w[informative].sum(), least))
    return blocks.over_larger(kept), share


def _block_correlations(
    values: Floats, predicted: Floats, weights: Floats, blocks: Blocks
) -> tuple[Floats, Floats, Floats]:
    """Return correlation, variance of the map and weight, (larger blocks,) each."""
    columns = np.ones((3, len(values)), np.float32)
    np.subtract(values, values.mean(), out=columns[1])
    np.subtract(predicted, predicted.mean(), out=columns[2])
    moments = blocks.larger_products(columns * weights, columns)
    total = moments[:, 0, 0]
    w = np.maximum(total, 1e-20)
    v, m = (moments[:, k, 0] / w for k in (1, 2))
    var_v = np.maximum(moments[:, 1, 1] / w - v**2, 0.0)
    var_m = np.maximum(moments[:, 2, 2] / w - m**2, 0.0)
    alike = (moments[:, 1, 2] / w - v * m) / np.maximum(np.sqrt(var_v * var_m), 1e-12)
    return alike, var_m, total


def mean_normalised_square(residual: Floats, weights: Floats) -> float:
    """Return a robust mean of r² W (1 if the weights are 1/variance), from its lower third."""
    part = slice(None, None, max(len(residual) // 2500, 1))
    used, squares = weights[part], residual[part] ** 2
    squares *= used
    if not used.all():
        squares = squares[used > 0.0]
    if not squares.size:
        return 1.0
    return max(_quantile(squares, TRIMMED) / TRIMMED_CHI_SQ, 1e-6)


def _quantile(values: Floats, share: float) -> float:
    """Return the value at a share of the ranks, without interpolation."""
    rank = int(share * (len(values) - 1))
    return float(np.partition(values, rank)[rank])


def outlier_scale(residual: Floats, weights: Floats, scale_sq: float) -> float:
    """
    Return the number of standard deviations beyond which residuals lose their weight.

    Where all residuals are noise, their mean square relative to `scale_sq` is near 1, and narrow
    limits would increase the error by a few hundredths. Above 1 some residuals are outliers; far
    below 1 the assumed noise is so large that a narrow limit is still wide.

    """
    cells = max(int(np.count_nonzero(weights)), 1)
    spread = float((weights * residual) @ residual) / (cells * scale_sq)
    return float(np.interp(spread, SPREADS, OUTLIERS))


def robust_weights(
    residual: Floats, weights: Floats, scale_sq: float, outlier_scale: float
) -> tuple[Floats, Floats]:
    """
    Return Geman-McClure weights (n,), and the slope (n,) of residual times weight, at least 0.

    Weights are near 1 for residuals within the scale and near 0 far outside.

    """
    ratio = residual**2 * weights * np.float32(1.0 / (outlier_scale**2 * scale_sq))
    weight = 1.0 / (1.0 + ratio) ** 2
    slope = weight * np.maximum(1.0 - 3.0 * ratio, 0.0) / (1.0 + ratio)
    return np.asarray(weight), np.asarray(slope)
