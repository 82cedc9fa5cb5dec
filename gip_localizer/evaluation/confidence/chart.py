# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Reliability of the confidence: how often matches of a confidence are right."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from matplotlib.figure import Figure
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.evaluation.confidence.fit import Design
from gip_localizer.visualization.style import BAND, ESTIMATE, TRUTH

EDGES = (0.0, 0.02, 0.1, 0.3, 0.7, 0.9, 0.98, 1.0)
"""Limits of the confidence (0 to 1) between which trials are counted together; chosen."""


@dataclass(frozen=True)
class Bin:
    """
    Trials of about the same confidence.

    Attributes
    ----------
    low, high : float
        Between which their confidence lies.
    right, wrong : int
        How many there are.
    expected, found : float
        Mean confidence, and share that is right, right and wrong trials weighing the same in sum.

    """

    low: float
    high: float
    right: int
    wrong: int
    expected: float
    found: float


def reliability(design: Design, odds: Floats) -> list[Bin]:
    """Count the trials by the confidence (from log odds (n,)) that they were given."""
    confidence = 1.0 / (1.0 + np.exp(-odds))
    place = np.clip(np.searchsorted(EDGES, confidence, side='right') - 1, 0, len(EDGES) - 2)
    bins = []
    for k, (low, high) in enumerate(pairwise(EDGES)):
        held = place == k
        if held.any():
            weights, right = design.weights[held], design.right[held]
            bins.append(Bin(
                low, high, int(right.sum()), int((~right).sum()),
                float(np.average(confidence[held], weights=weights)),
                float(np.average(right, weights=weights)),
            ))
    return bins


def reliability_figure(bins: Sequence[Bin]) -> Figure:
    """Draw the share of right matches over the confidence, and how many trials there are."""
    figure = Figure(figsize=(7.0, 3.2))
    left, right = figure.subplots(1, 2)
    left.plot([0.0, 1.0], [0.0, 1.0], color=TRUTH, lw=1.0, label='calibrated')
    left.plot([b.expected for b in bins], [b.found for b in bins], 'o-', color=ESTIMATE, ms=5,
              label='parts that were left out of the fit')
    left.set_xlabel('confidence')
    left.set_ylabel('share of right matches')
    left.legend(fontsize=8)
    places = np.arange(len(bins))
    right.bar(places - 0.2, [b.right for b in bins], 0.4, color=ESTIMATE, label='right')
    right.bar(places + 0.2, [b.wrong for b in bins], 0.4, color=BAND, label='wrong')
    right.set_xticks(places, [f'{b.low:g}-{b.high:g}' for b in bins], rotation=45, ha='right')
    right.set_yscale('symlog', linthresh=1.0)
    right.set_xlabel('confidence')
    right.set_ylabel('trials')
    right.legend(fontsize=8)
    return figure
