# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Waiting for the subscribers of a drive before its first message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import time

from rclpy.publisher import Publisher

LISTENERS = 5.0
"""Time (s) between the subscription of all listeners that were waited for and the first frame:
they discover the publisher and precompute meanwhile. That a listener is known to the publisher
does not mean that it knows the publisher: an announcement that a busy machine loses is repeated
only after 3 s (Fast DDS)."""
ANNOUNCEMENT = 1.0
"""Time (s) between two calibrations ahead of the first frame; chosen."""


class ListenerWait:
    """
    Waits until topics have subscribers, and then until these are prepared.

    Parameters
    ----------
    awaited : sequence of Publisher
        Each must get a subscriber; none: nothing is waited for.
    announce : callable
        Sends what subscribers need to prepare, every `ANNOUNCEMENT` seconds.

    """

    def __init__(self, awaited: Sequence[Publisher], announce: Callable[[], object]) -> None:
        self._awaited = list(awaited)
        self._announce = announce
        self._begins = self._announces = 0.0

    def over(self) -> bool:
        """Return whether the first message may be sent; once true, it stays so."""
        now = time.monotonic()
        if self._awaited:
            if not all(publisher.get_subscription_count() for publisher in self._awaited):
                return False
            self._awaited = []
            self._begins = now + LISTENERS
        if now < self._begins and now >= self._announces:
            self._announces = now + ANNOUNCEMENT
            self._announce()
        return now >= self._begins
