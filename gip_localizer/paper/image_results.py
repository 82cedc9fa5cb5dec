# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Results of the experiment on images, and their table `pipeline.csv`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from scipy.stats import binomtest


@dataclass(frozen=True)
class PipelinePoint:
    """
    One measured error rate.

    Attributes
    ----------
    amplitude : float
        The paper's a.
    inner_product : str
        generalized or standard.
    rectifier : str
        One of `RECTIFIERS`.
    trials, errors : int
        Number of frames, and of those in which û scores better.
    theory : float
        Mean P(error) over the pairs of the trials, which assumes footprint means.

    """

    amplitude: float
    inner_product: str
    rectifier: str
    trials: int
    errors: int
    theory: float

    @property
    def rate(self) -> float:
        """Measured probability of error."""
        return self.errors / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Exact (Clopper-Pearson) 95 % interval of the probability of error."""
        interval = binomtest(self.errors, self.trials).proportion_ci(0.95, method='exact')
        return float(interval.low), float(interval.high)

    @property
    def agrees(self) -> bool:
        """True if the theory lies in the interval."""
        low, high = self.interval
        return low <= self.theory <= high


def table_rows(points: Iterable[PipelinePoint]) -> Iterator[tuple[object, ...]]:
    """Yield the rows of `pipeline.csv` (columns: `COLUMNS`)."""
    for point in points:
        yield (
            point.amplitude, point.inner_product, point.rectifier, point.trials, point.errors,
            point.rate, *point.interval, point.theory, int(point.agrees),
        )


COLUMNS = (
    'amplitude', 'inner_product', 'rectifier', 'trials', 'errors', 'rate', 'low_95', 'high_95',
    'theory', 'theory_inside',
)
