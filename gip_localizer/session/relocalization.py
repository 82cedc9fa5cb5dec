# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The outcome of a search of the whole map: found, ambiguous or not found."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import NamedTuple

from gip_localizer.core.estimate import Estimate, Status

PATIENCE = 60.0
"""Longest time (s) until an answer; the largest map tried (1 ha) takes 14 s and some frames."""
UNDECIDED = (Status.CONFIRMING, Status.OUT_OF_ORDER, Status.BAD_IMAGE, Status.FROZEN_IMAGE,
             Status.NO_MASK)
"""What says nothing of the place yet: the next frame is waited for."""


class Outcome(NamedTuple):
    """Whether the place was found, and the answer in words."""

    found: bool
    text: str


class Relocalization:
    """
    Watches the estimates after a request.

    Parameters
    ----------
    steady : callable
        Seconds that never go back.

    """

    def __init__(self, steady: Callable[[], float] = time.monotonic) -> None:
        self._steady = steady
        self._began = float('-inf')
        self._last = 'no image came'

    def begin(self) -> None:
        """Note that the next frame is searched for."""
        self._began, self._last = self._steady(), 'no image came'

    def outcome(self, estimate: Estimate) -> Outcome | None:
        """Return what a frame decides; None: the next one is waited for."""
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
        """Return an answer where none came in time."""
        if self._steady() - self._began < PATIENCE:
            return None
        return Outcome(False, f'not found: nothing was decided in {PATIENCE:g} s, {self._last}')
