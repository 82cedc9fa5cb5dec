# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Which frames are used: each one that is newer than the frame before it.

A stamp far from the last one may be a single wrong stamp, or time itself may have jumped (a bag
in a loop, a long pause). The next frame decides, so that a single wrong stamp does not reset the
belief. A step ahead of less than a minute is accepted at once; if the next frame is older than
it, its stamp was wrong.

"""

from __future__ import annotations

# Step back (ns) from which time has restarted; smaller ones are frames out of order (design
# choice: longer than any transport delays a frame).
REWIND_NS = 1_000_000_000
# Step ahead (ns) from which a stamp may prove wrong (design choice: several times the period of
# the slowest cameras).
HOP_NS = 500_000_000
# Step ahead (ns) that the next frame must confirm (design choice).
LEAP_NS = 60_000_000_000
# Time (ns) before the last frame from which a stamp must be of another clock: odometry is kept
# for as long.
LONG_PAST_NS = 20_000_000_000


class StampCheck:
    """
    Checks the stamps of frames in the order of their arrival.

    Attributes
    ----------
    hopped : bool
        The frame is used, and the next frame may show that its stamp was too late.
    returned : bool
        The frame is used, and the stamp of the one before was too late.
    went_back : float
        Seconds by which the frame confirms that time went back; 0: it did not.

    """

    def __init__(self) -> None:
        self.hopped = self.returned = False
        self.went_back = 0.0
        self._last_ns: int | None = None
        self._before_ns: int | None = None  # the frame before a step ahead
        self._unconfirmed_ns: int | None = None

    def __str__(self) -> str:
        """Return the stamp of the last frame, and that of a jump that is not confirmed yet."""
        last = 'no frame yet' if self._last_ns is None else f'last frame {self._last_ns} ns'
        if self._unconfirmed_ns is None:
            return last
        return f'{last}, {self._unconfirmed_ns} ns to be confirmed'

    def is_long_past(self, stamp_ns: int) -> bool:
        """Return whether a stamp is so far before the last frame that its clock must differ."""
        return self._last_ns is not None and stamp_ns < self._last_ns - LONG_PAST_NS

    def fault(self, stamp_ns: int) -> str:
        """Return why a frame is not used; an empty string if it is used."""
        self.hopped = self.returned = False
        self.went_back = 0.0
        last, before = self._last_ns, self._before_ns
        jumped, self._unconfirmed_ns = self._unconfirmed_ns, None
        if last is None:
            self._last_ns = stamp_ns
            return ''
        ahead = stamp_ns - last
        self.returned = ahead < 0 and before is not None and stamp_ns > before
        if not self.returned:
            if -REWIND_NS <= ahead <= 0:
                return f'frame is {-ahead * 1e-6:.1f} ms behind the one before; skipped'
            if not -REWIND_NS <= ahead <= LEAP_NS and (jumped is None or stamp_ns <= jumped):
                self._unconfirmed_ns = stamp_ns
                return (
                    f'frame is {abs(ahead) * 1e-9:.1f} s {"behind" if ahead < 0 else "ahead of"} '
                    'the one before; its time is accepted if the next frame continues from it'
                )
            self.went_back = max(-ahead, 0) * 1e-9
            self.hopped = ahead > HOP_NS
        self._before_ns = last if self.hopped else None
        self._last_ns = stamp_ns
        return ''
