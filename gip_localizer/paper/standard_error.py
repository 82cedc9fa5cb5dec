# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The standard error of a mean over N sampled pairs about the exact curve.

For amplitudes ±a the argument of Φ depends on the pair only through the number D of squares that
differ and a sum V over them. It is `a √(f² h secθ / N0)` times √V with V = Σ G (generalized), or
times D / √V with V = Σ 1/G (standard). The joint law of (D, V) is a convolution over the rows. It
is computed on a fine lattice of V, to about four digits, which is sufficient for an error bar.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr
from scipy.stats import binom

from gip_localizer.core.arrays import Floats
from gip_localizer.paper.squares import Squares

MAX_BINS, MIN_BINS = 4000, 300
"""Largest and least number of bins of V; chosen."""
MAX_STATES = 300_000
"""Largest number of states of D and V together, which bounds the time; chosen."""
NEGLIGIBLE = 1e-25
"""Probability below which a state is dropped; chosen."""


@dataclass(frozen=True, eq=False)
class PairLaw:
    """
    Law of the argument of Φ over all pairs, in units of `a √(f² h secθ / N0)`.

    Attributes
    ----------
    arguments : (n,) float64
        Values.
    probabilities : (n,) float64
        Their probabilities; they sum to one.

    """

    arguments: Floats
    probabilities: Floats

    def standard_error(self, amplitude: float, snr_constant: float, samples: int) -> float:
        """Return the standard deviation of the mean probability of error of N pairs."""
        error = ndtr(-amplitude * np.sqrt(snr_constant) * self.arguments)
        mean = float(self.probabilities @ error)
        return float(np.sqrt(self.probabilities @ (error - mean) ** 2 / samples))


def pair_law(squares: Squares, *, generalized: bool) -> PairLaw:
    """Return the law of the argument for one of the two inner products."""
    per_square = squares.row_gramian if generalized else 1.0 / squares.row_gramian
    joint, step = _joint_law(squares, per_square)
    differing, bins = np.nonzero(joint > NEGLIGIBLE)
    total = bins * step
    root = np.sqrt(total)
    plain = np.divide(differing, root, out=np.zeros_like(root), where=root > 0.0)
    return PairLaw(root if generalized else plain, joint[differing, bins])


def _joint_law(squares: Squares, per_square: Floats) -> tuple[Floats, float]:
    """Return the law over (D, bin of V) and the bin width; values are split between two bins."""
    bins = min(max(MAX_STATES // squares.total, MIN_BINS), MAX_BINS)
    step = float(squares.counts @ per_square) / bins
    law = np.zeros((squares.total + 1, bins + len(squares.counts) + 2))
    law[0, 0] = 1.0
    for count, value in zip(squares.counts, per_square, strict=True):
        spread = np.zeros_like(law)
        for differ, chance in enumerate(binom.pmf(np.arange(count + 1), count, 0.5)):
            whole = int(differ * value / step)
            part = differ * value / step - whole
            for shift, share in ((whole, 1.0 - part), (whole + 1, part)):
                spread[differ:, shift:] += (
                    chance * share * law[: len(law) - differ, : law.shape[1] - shift]
                )
        law = spread
    return law, step
