# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Logistic regression of right and wrong matches on the logarithms of their figures.

Right and wrong trials weigh the same in sum, so that the confidence is the probability of a right
match where half of the matches are right. A figure can speak for a match in one sense only
(`SENSES`): a weight of the other sign would be chance.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import minimize

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.confidence import Term
from gip_localizer.evaluation.confidence.trials import ConfidenceTrial, FIGURES

SENSES: Mapping[str, float] = {
    'margin': 1.0, 'significance': 1.0, 'agreement': 1.0, 'overdispersion': -1.0,
    'sigma_cells': -1.0, 'suspension': -1.0,
}
"""Of each figure: 1 where more of it speaks for a match, -1 where it speaks against."""
QUANTILES = (0.02, 0.98)
"""Of a figure over the trials (no unit): beyond them it counts as at them; chosen."""
LEAST_FIGURE = 1e-2
"""Smallest figure (no unit) whose logarithm is taken; chosen."""
PLAIN = {'overdispersion': 1.0, 'suspension': 1.0}
"""Figures (no unit) up to which all is as noise model and calibration say: no evidence."""
RIDGE = 2e-4
"""Log loss per squared weight of a standardized figure; measured: 1e-3 and 5e-5 fit no better."""
LEAST_GAIN = 0.02
"""Share (no unit) of the log loss of left-out parts that a figure must take away; chosen."""
DIGITS = 3
"""Significant digits of the numbers that the core holds; chosen."""


@dataclass(frozen=True)
class Regression:
    """
    The fitted probability.

    Attributes
    ----------
    offset : float
        Log odds where the logarithms of all figures are zero.
    terms : tuple of Term
        Figures that earn their place.

    """

    offset: float
    terms: tuple[Term, ...]


@dataclass(frozen=True, eq=False)
class Design:
    """
    The trials as arrays.

    Attributes
    ----------
    names : tuple of str
        Figures, one per column.
    limits : (k, 2) float64
        Between which a figure is taken as it is.
    logs : (n, k) float64
        Natural logarithms of the figures within their limits.
    right : (n,) bool
        Which matches are right.
    weights : (n,) float64
        Of the trials; right and wrong ones sum to 1/2 each.
    groups : (n,) int
        Number of the trial's part.

    """

    names: tuple[str, ...]
    limits: Floats
    logs: Floats
    right: Bools
    weights: Floats
    groups: np.ndarray  # type: ignore[type-arg]

    @classmethod
    def of(cls, trials: Sequence[ConfidenceTrial]) -> Design:
        """Return the design of some trials."""
        values = np.array([[trial.figures[name] for name in FIGURES] for trial in trials])
        least = [[PLAIN.get(name, LEAST_FIGURE)] for name in FIGURES]
        limits = np.maximum(np.quantile(values, QUANTILES, axis=0).T, least)
        limits = np.array([[_rounded(v) for v in pair] for pair in limits])
        right = np.array([trial.right for trial in trials])
        share = np.where(right, right.sum(), (~right).sum())
        _, groups = np.unique([trial.part for trial in trials], return_inverse=True)
        return cls(FIGURES, limits, np.log(np.clip(values, limits[:, 0], limits[:, 1])), right,
                   0.5 / share, groups)

    def fitted(self, columns: Sequence[int], chosen: Bools | None = None) -> Floats:
        """Return offset and weights (1 + k,) of some columns, from the trials that are chosen."""
        chosen = np.ones(len(self.right), bool) if chosen is None else chosen
        logs, right = self.logs[chosen][:, columns], self.right[chosen]
        weights = self.weights[chosen] / self.weights[chosen].sum()
        centre, spread = logs.mean(axis=0), np.maximum(logs.std(axis=0), 1e-9)
        scaled = np.column_stack([np.ones(len(logs)), (logs - centre) / spread])
        signs = np.where(right, 1.0, -1.0)
        senses = [SENSES[self.names[column]] for column in columns]

        def loss(theta: Floats) -> tuple[float, Floats]:
            odds = signs * (scaled @ theta)
            pull = -weights * signs / (1.0 + np.exp(odds))
            ridge = np.concatenate([[0.0], theta[1:]])
            value = weights @ np.logaddexp(0.0, -odds) + RIDGE * ridge @ ridge
            return float(value), scaled.T @ pull + 2.0 * RIDGE * ridge

        bounds = [(None, None), *((0.0, None) if s > 0 else (None, 0.0) for s in senses)]
        found = minimize(loss, np.zeros(len(columns) + 1), jac=True, bounds=bounds,
                         method='L-BFGS-B', options={'ftol': 1e-14, 'gtol': 1e-10})
        slopes = found.x[1:] / spread
        return np.concatenate([[found.x[0] - slopes @ centre], slopes])

    def left_out(self, columns: Sequence[int]) -> Floats:
        """Return log odds (n,) of each trial from a fit to the trials of all other parts."""
        odds = np.empty(len(self.right))
        for group in range(self.groups.max() + 1):
            held = self.groups == group
            theta = self.fitted(columns, ~held)
            odds[held] = theta[0] + self.logs[held][:, columns] @ theta[1:]
        return odds

    def loss(self, odds: Floats) -> float:
        """Mean log loss of log odds (n,)."""
        signed = np.where(self.right, odds, -odds)
        return float(self.weights @ np.logaddexp(0.0, -signed))


def select(design: Design) -> tuple[int, ...]:
    """
    Choose the figures that earn their place.

    Of all sets of figures the one with the least log loss of left-out parts, where each figure
    must take a share of `LEAST_GAIN` away.

    """
    everything = range(len(design.names))
    sets = [s for size in everything for s in combinations(everything, size + 1)]
    return min(sets, key=lambda s: design.loss(design.left_out(s)) / (1.0 - LEAST_GAIN)**len(s))


def regress(design: Design, columns: Sequence[int]) -> Regression:
    """Fit some columns to all trials; numbers as the core holds them."""
    theta = design.fitted(columns)
    return Regression(_rounded(theta[0]), tuple(
        Term(design.names[column], _rounded(weight), *design.limits[column].tolist())
        for column, weight in zip(columns, theta[1:], strict=True)
    ))


def _rounded(value: float) -> float:
    return float(f'{value:.{DIGITS}g}')
