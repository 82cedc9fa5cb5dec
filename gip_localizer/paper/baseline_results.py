# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Results of the comparison with other methods, and their table `beyond.csv`."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from scipy.stats import binomtest


@dataclass(frozen=True)
class BeyondPoint:
    """Successes of one method at one task and amplitude."""

    task: str
    amplitude: float
    method: str
    trials: int
    successes: int

    @property
    def rate(self) -> float:
        """Fraction of frames within half a tile of the truth."""
        return self.successes / self.trials

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95 % interval of the success rate."""
        interval = binomtest(self.successes, self.trials).proportion_ci(0.95, method='wilson')
        return float(interval.low), float(interval.high)


def table_rows(points: Iterable[BeyondPoint]) -> Iterator[tuple[object, ...]]:
    """Yield the rows of `beyond.csv` (columns: `COLUMNS`)."""
    for point in points:
        yield (
            point.task, point.amplitude, point.method, point.trials, point.successes, point.rate,
            *point.interval,
        )


COLUMNS = (
    'task', 'amplitude', 'method', 'trials', 'successes', 'success_rate', 'low_95', 'high_95',
)
