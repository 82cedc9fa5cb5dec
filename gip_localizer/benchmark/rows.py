# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""One line of the benchmark, and how times are taken: interleaved, medians, spread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
import time
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Row:
    """
    One case beside its peer.

    Attributes
    ----------
    suite, case : str
        What was measured.
    ours_ms : float
        Median time per frame.
    peer : str
        What it is compared with; empty: nothing.
    peer_ms, ratio : float or None
        Its median time, and peer_ms / ours_ms.
    same_winner : float or None
        Share of frames on which both choose the same candidate.

    """

    suite: str
    case: str
    ours_ms: float
    peer: str = ''
    peer_ms: float | None = None
    ratio: float | None = None
    same_winner: float | None = None

    def as_dict(self) -> dict[str, Any]:
        """Return the row as it is written to bench.json."""
        return asdict(self)


def beside(
    suite: str, case: str, ours_ms: float, peer: str, peer_ms: float,
    same_winner: float | None = None,
) -> Row:
    """Return the row of a case and its peer."""
    return Row(suite, case, ours_ms, peer, peer_ms, peer_ms / ours_ms, same_winner)


def interleaved(
    work: Mapping[str, Callable[[], object]], rounds: int, *, warm: int = 1
) -> dict[str, list[float]]:
    """Return the times (ms) of each piece of work, one after the other in every round."""
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
