# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Rows of the benchmark, and measurement of times: interleaved runs, medians, percentiles."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
import time
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Row:
    """
    One case, compared with its baseline.

    Attributes
    ----------
    suite, case : str
        What is measured.
    ours_ms : float
        Median time per frame.
    peer : str
        Name of the baseline; empty if there is none.
    peer_ms, ratio : float or None
        Median time of the baseline, and the speed-up peer_ms / ours_ms: above 1 if this package
        is faster.
    same_winner : float or None
        Fraction of frames on which both choose the same candidate.

    """

    suite: str
    case: str
    ours_ms: float
    peer: str = ''
    peer_ms: float | None = None
    ratio: float | None = None
    same_winner: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the row as a dictionary for bench.json."""
        return asdict(self)


def compared_row(
    suite: str, case: str, ours_ms: float, peer: str, peer_ms: float,
    same_winner: float | None = None,
) -> Row:
    """Return the row of a case and its baseline."""
    return Row(suite, case, ours_ms, peer, peer_ms, peer_ms / ours_ms, same_winner)


def interleaved(
    work: Mapping[str, Callable[[], object]], rounds: int, *, warm: int = 1
) -> dict[str, list[float]]:
    """Return the times (ms) of each function; every round calls all functions in turn."""
    times: dict[str, list[float]] = {name: [] for name in work}
    for k in range(warm + rounds):
        for name, piece in work.items():
            start = time.perf_counter()
            piece()
            if k >= warm:
                times[name].append(1e3 * (time.perf_counter() - start))
    return times


def median(times: Sequence[float]) -> float:
    """Return the median."""
    return float(np.median(times))


def spread(times: Sequence[float]) -> tuple[float, float]:
    """Return the 10th and the 90th percentile."""
    low, high = np.percentile(times, (10.0, 90.0))
    return float(low), float(high)


def exponent(sizes: Sequence[float], times: Sequence[float]) -> float:
    """Return the slope of log time over log size (least squares)."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])
