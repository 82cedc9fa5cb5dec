# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A position in a bag that is played: what is due, step, seek."""

from __future__ import annotations

from collections.abc import Collection, Iterator

from gip_localizer.errors import BagError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.source import BagMessage

NS = 1_000_000_000
"""Nanoseconds per second."""
LATEST_NS = 2**31 * NS
"""Log times (ns) from here on do not fit the seconds of a ROS stamp."""


class Playback:
    """
    A position in a bag.

    Messages that were logged outside of the drive (at time 0, or at the end of time) are not
    played: `Bag.notes` names them.

    Parameters
    ----------
    bag : Bag
        The recording.
    topics : collection of str
        Names of the topics that are played.
    start_ns : int
        Log time of the position.

    Attributes
    ----------
    now_ns : int
        The position, nanoseconds of log time.

    Raises
    ------
    BagError
        The log times of the bag are no times of ROS, or nothing is logged from the position on.

    """

    def __init__(self, bag: Bag, topics: Collection[str], start_ns: int) -> None:
        if bag.end_ns >= LATEST_NS:
            raise BagError(
                f'the messages of the bag are logged at {bag.start_ns * 1e-9:.3g} to '
                f'{bag.end_ns * 1e-9:.3g} s; expected seconds since 1970, below '
                f'{LATEST_NS * 1e-9:.3g}: record it again with a clock that is set'
            )
        self._bag, self._topics = bag, list(topics)
        if not self.seek(start_ns):
            raise BagError(
                f'parameter start: the bag ends {(bag.end_ns - bag.start_ns) * 1e-9:.3f} s after '
                'its begin; expected less'
            )

    def seek(self, log_ns: int) -> bool:
        """Go to a log time; return whether it lies in the drive (else the position stays)."""
        first, last = self._bag.start_ns, self._bag.end_ns
        if not first <= log_ns <= last:
            return False
        self._messages: Iterator[BagMessage] = self._bag.messages(self._topics, log_ns, last + 1)
        self._next = next(self._messages, None)
        self.now_ns = log_ns if self._next is None else self._next.log_ns
        return True

    def before(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Return the messages of some topics that were recorded before the position."""
        return self._bag.messages(topics, self._bag.start_ns, self.now_ns)

    @property
    def ended(self) -> bool:
        """Whether nothing is left."""
        return self._next is None

    def advance(self, elapsed_ns: int) -> Iterator[BagMessage]:
        """Yield what becomes due within a time of the bag, and move on by it."""
        until = self.now_ns + elapsed_ns
        while self._next is not None and self._next.log_ns <= until:
            yield self._take(self._next)
        self.now_ns = until

    def step(self) -> BagMessage | None:
        """Return the next message, if there is one, and move on to it."""
        return None if self._next is None else self._take(self._next)

    def _take(self, message: BagMessage) -> BagMessage:
        self.now_ns = message.log_ns
        self._next = next(self._messages, None)
        return message
