# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The curves of Fig. SimResultsD8 without sampling.

The points of the figure are means of WeightedCDF and UnweightedCDF over random pairs u*, û of
amplitudes ±a. If noise *and* pair are random, such a mean is the probability that

    Y = Σ_k b_k w_k (a + n_k) < 0,

with w = G (generalized) or w = 1 (standard), n_k normal with variance N0/Ã_k, and b_k = 1 if the
vectors differ in square k (probability one half), else 0. All terms are independent, so Y has the
transform

    M(s) = E exp(−s Y) = Π_k ½(1 + exp(−s w_k a + s² w_k² σ_k²/2)),

and P(Y < 0) is the Bromwich integral of M(s)/s along Re s = c > 0. Through the saddle point c the
trapezoidal rule converges exponentially, so that even the smallest probabilities are accurate.

"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq, minimize_scalar

from gip_localizer.core.arrays import Floats
from gip_localizer.paper.squares import Squares

Complexes = NDArray[np.complexfloating[Any, Any]]

TAIL = 9.0
"""Number of standard deviations beyond which a normal law is below double precision."""
ALIAS = 40.0
"""Exponent of the error exp(−40) that the step of the trapezoidal rule leaves (no unit)."""


def exact_error(
    amplitude: float, squares: Squares, snr_constant: float, *, generalized: bool
) -> float:
    """
    Mean probability of error over all pairs in {±a}^m, one point of Fig. SimResultsD8.

    Parameters
    ----------
    amplitude : float
        a > 0.
    squares : Squares
        The squares and their Gramian.
    snr_constant : float
        `f² h secθ / N0`.
    generalized : bool
        True: the mean of WeightedCDF; False: of UnweightedCDF.

    Returns
    -------
    float
        Probability, exact to about 12 digits.

    """
    weight = squares.row_gramian if generalized else np.ones_like(squares.row_gramian)
    sigma = weight / np.sqrt(snr_constant * squares.row_gramian)
    return _probability_below_zero(weight * amplitude, sigma, squares.counts.astype(float))


def equal_error_amplitude(
    probability: float, squares: Squares, snr_constant: float, *, generalized: bool
) -> float:
    """
    Return the amplitude at which the exact curve has a given probability.

    NaN if the curve never reaches it: pairs of equal vectors have a probability of error of one
    half at any amplitude.

    """
    if probability <= 0.51 * 2.0**-squares.total:
        return math.nan
    def excess(log_amplitude: float) -> float:
        amplitude = math.exp(log_amplitude)
        error = exact_error(amplitude, squares, snr_constant, generalized=generalized)
        return math.log(error / probability)

    unit = 1.0 / math.sqrt(snr_constant * float(squares.gramian.sum()))
    low, high = math.log(1e-4 * unit), math.log(unit)
    while excess(high) > 0.0:
        high += 1.0
    return math.exp(brentq(excess, low, high, xtol=1e-10))


def gain_db(probability: float, squares: Squares, snr_constant: float) -> float:
    """Return how much less signal the generalized inner product needs at equal error, dB."""
    standard, generalized = (
        equal_error_amplitude(probability, squares, snr_constant, generalized=flag)
        for flag in (False, True)
    )
    return 20.0 * math.log10(standard / generalized)


def _probability_below_zero(mean: Floats, sigma: Floats, counts: Floats) -> float:
    """P(Y < 0) for a sum over rows of `counts` normals, each present with probability one half."""
    scale = math.sqrt(0.5 * float(counts @ sigma**2))
    rows = _Rows(mean / scale, sigma / scale, counts)
    saddle = rows.saddle_point()
    period = ALIAS / saddle + 2.0 * (float(rows.mean @ counts) + 2.0 * TAIL)
    nodes = math.ceil(rows.reach(saddle) * period / (2.0 * math.pi))
    s = saddle + 2j * math.pi / period * np.arange(nodes + 1)
    # No square differs with probability 2^-m: there the paper's 0/0 counts as one half.
    same = math.exp(-float(counts.sum()) * math.log(2.0))
    values = np.real((rows.transform(s) - same) / s)
    values[0] *= 0.5
    return float(2.0 / period * values.sum() + 0.5 * same)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Mean and standard deviation of a square's term, and number of squares; all (rows,)."""

    mean: Floats
    sigma: Floats
    counts: Floats

    def transform(self, s: Complexes) -> Complexes:
        """M(s), (n,)."""
        result = np.ones_like(s)
        for mean, sigma, count in zip(self.mean, self.sigma, self.counts, strict=True):
            result *= (0.5 + 0.5 * np.exp(s * (0.5 * sigma**2 * s - mean))) ** int(count)
        return result

    def saddle_point(self) -> float:
        """Return c > 0 with the least M(c)/c, where the integrand does not cancel."""

        def log_integrand(log_c: float) -> float:
            c = math.exp(log_c)
            exponent = c * (0.5 * self.sigma**2 * c - self.mean)
            return float(np.logaddexp(0.0, exponent) @ self.counts) - log_c

        best = minimize_scalar(log_integrand, bounds=(-4.0, 4.0), method='bounded')
        return math.exp(float(best.x))

    def reach(self, c: float) -> float:
        """Return the imaginary part beyond which M(c + iω) is below double precision of M(c)."""
        longest = TAIL / float(self.sigma.min())
        omega = np.geomspace(1.0, max(longest, 2.0), 80)
        size = np.exp(c * (0.5 * self.sigma**2 * c - self.mean))
        fading = np.exp(-0.5 * np.multiply.outer(omega**2, self.sigma**2))
        log_bound = np.log((1.0 + size * fading) / (1.0 + size)) @ self.counts
        below = np.flatnonzero(log_bound < -ALIAS)
        return float(omega[below[0]]) if below.size else longest
