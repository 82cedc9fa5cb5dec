# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The probability that a match is at the right place: a logistic function of its figures."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import NamedTuple


class Term(NamedTuple):
    """
    Contribution of one figure of a match to the log odds: `weight * ln(figure)`.

    Attributes
    ----------
    figure : str
        Name of the figure.
    weight : float
        Weight of the natural logarithm of the figure (no unit).
    low, high : float
        Limits to which the figure is clipped.

    """

    figure: str
    weight: float
    low: float
    high: float


def confidence(figures: Mapping[str, float], offset: float, terms: tuple[Term, ...]) -> float:
    """
    Return the probability that a match is right, if half of all matches are right.

    Parameters
    ----------
    figures : mapping
        Figures of the match by name.
    offset : float
        Log odds where the logarithms of all figures are zero.
    terms : tuple of Term
        Contributions of the figures.

    """
    odds = offset + sum(
        term.weight * math.log(min(max(figures[term.figure], term.low), term.high))
        for term in terms
    )
    return 1.0 / (1.0 + math.exp(-odds))
