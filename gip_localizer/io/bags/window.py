# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The part of a bag that is read."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.errors import ParameterError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.source import END

MOST_SECONDS = 1e9
"""Largest time (s) that is accepted, 32 years; chosen."""


@dataclass(frozen=True)
class BagWindow:
    """
    The part of a bag to replay.

    Attributes
    ----------
    start_s : float
        Seconds after the drive's first message; 0: nothing is skipped.
    duration_s : float or None
        Seconds; None: to the end.

    """

    start_s: float = 0.0
    duration_s: float | None = None

    def __post_init__(self) -> None:
        """Check both times (raises ParameterError)."""
        if not 0.0 <= self.start_s <= MOST_SECONDS:
            raise ParameterError(
                f'--start {self.start_s}: expected seconds from 0 to {MOST_SECONDS:g}'
            )
        if self.duration_s is not None and not 0.0 < self.duration_s <= MOST_SECONDS:
            raise ParameterError(
                f'--duration {self.duration_s}: expected seconds above 0, up to {MOST_SECONDS:g}'
            )

    def log_times(self, bag: Bag) -> tuple[int, int]:
        """Return the first log time (ns) and the one at which to stop."""
        start = bag.start_ns + round(self.start_s * 1e9)
        stop = END if self.duration_s is None else start + round(self.duration_s * 1e9)
        return (start if self.start_s else 0), stop

    def share(self, bag: Bag) -> float:
        """Return the share of the bag's time that is replayed."""
        start, stop = self.log_times(bag)
        length = max(bag.end_ns - bag.start_ns, 1)
        replayed = min(stop, bag.end_ns) - max(start, bag.start_ns)
        return min(max(replayed / length, 0.0), 1.0)
