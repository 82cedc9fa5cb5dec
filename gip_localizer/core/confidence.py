# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The probability that a match is at the right place: a logistic function of its figures."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import NamedTuple


class Term(NamedTuple):
    """
    What one figure of a match contributes to the log odds: `weight * ln(figure)`.

    Attributes
    ----------
    figure : str
        Name among the figures of a match.
    weight : float
        Per natural logarithm of the figure.
    low, high : float
        A figure beyond these counts as if it were at them.

    """

    figure: str
    weight: float
    low: float
    high: float


def confidence(figures: Mapping[str, float], offset: float, terms: tuple[Term, ...]) -> float:
    """
    Return the probability that a match is right, where half of all matches are.

    Parameters
    ----------
    figures : mapping
        Of the match, by name.
    offset : float
        Log odds where the logarithms of all figures are zero.
    terms : tuple of Term
        What is added to it.

    """
    odds = offset + sum(
        term.weight * math.log(min(max(figures[term.figure], term.low), term.high))
        for term in terms
    )
    return 1.0 / (1.0 + math.exp(-odds))
