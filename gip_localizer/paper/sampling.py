# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's sampling: random pairs u*, û of amplitudes ±a, and their mean error."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.paper.theory import unweighted_cdf, weighted_cdf

BATCH = 10_000
"""Number of pairs drawn at once, which bounds the memory; chosen."""


def sampled_errors(
    amplitude: float,
    gramian: Floats,
    snr_constant: float,
    samples: int,
    rng: np.random.Generator,
) -> tuple[float, float]:
    """
    Return the means of UnweightedCDF and of WeightedCDF over random pairs.

    Parameters
    ----------
    amplitude : float
        a.
    gramian : (m,) float64
        Diagonal of G.
    snr_constant : float
        `f² h secθ / N0`.
    samples : int
        Number of pairs, at least 1; both means use the same pairs.
    rng : numpy.random.Generator
        Source of the pairs.

    Returns
    -------
    standard, generalized : float
        Probabilities of error.

    """
    standard = generalized = 0.0
    for start in range(0, samples, BATCH):
        shape = (2, min(BATCH, samples - start), len(gramian))
        truth, other = amplitude * (2.0 * rng.integers(0, 2, shape, dtype=np.int8) - 1.0)
        standard += float(unweighted_cdf(truth, other, gramian, snr_constant).sum())
        generalized += float(weighted_cdf(truth, other, gramian, snr_constant).sum())
    return standard / samples, generalized / samples
