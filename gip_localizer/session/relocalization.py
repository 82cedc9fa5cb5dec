# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The outcome of a search of the whole map: found, ambiguous or not found."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import NamedTuple

from gip_localizer.core.estimate import Estimate, Status

TIMEOUT = 60.0
"""Longest time (s) until an answer; chosen: a search of 1 ha took 14 s (BENCHMARK.md)."""
UNDECIDED = (Status.CONFIRMING, Status.OUT_OF_ORDER, Status.BAD_IMAGE, Status.FROZEN_IMAGE,
             Status.NO_MASK)
"""Statuses that do not decide the search; the next frame is awaited."""


class Outcome(NamedTuple):
    """Whether the pose was found, and the text of the answer."""

    found: bool
    text: str


class Relocalization:
    """
    Evaluates the estimates after a request.

    Parameters
    ----------
    steady : callable
        Seconds of a steady clock.

    """

    def __init__(self, steady: Callable[[], float] = time.monotonic) -> None:
        self._steady = steady
        self._began = float('-inf')
        self._last = 'no image received'

    def begin(self) -> None:
        """Record that a search begins with the next frame."""
        self._began, self._last = self._steady(), 'no image received'

    def outcome(self, estimate: Estimate) -> Outcome | None:
        """Return the answer that a frame gives; None: the next frame is needed."""
        took = f'after {self._steady() - self._began:.1f} s'
        if estimate.pose is not None:
            x, y, yaw = estimate.pose
            confidence = estimate.quality.get('confidence', float('nan'))
            return Outcome(True, (
                f'found: x {x:.3f} m, y {y:.3f} m, yaw {yaw:.4f} rad, confidence '
                f'{confidence:.3f}, {took}'
            ))  # fmt: skip
        self._last = f'{estimate.status}: {estimate.reason}'
        if estimate.status in UNDECIDED:
            return None
        verdict = 'ambiguous' if estimate.status is Status.AMBIGUOUS else 'not found'
        return Outcome(False, f'{verdict}: {self._last}, {took}')

    def overdue(self) -> Outcome | None:
        """Return a negative answer if none was found within `TIMEOUT`."""
        if self._steady() - self._began < TIMEOUT:
            return None
        return Outcome(False, f'not found: no decision within {TIMEOUT:g} s, {self._last}')
