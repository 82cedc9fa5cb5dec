# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Which frames are taken: each one that is newer than the frame before it.

A stamp far from the last one may be a single wrong one, or time itself may have leapt (a bag in
a loop, a long pause): only the next frame tells, so that a wrong stamp costs no belief. A hop of
seconds is taken at once, and where the next frame comes from before it, it was wrong.

"""

from __future__ import annotations

REWIND_NS = 1_000_000_000  # a step back in time by more than this is a restart, not disorder
HOP_NS = 500_000_000  # a step ahead by more than this may have been wrong
LEAP_NS = 60_000_000_000  # a step ahead by more than this must be confirmed
LONG_PAST_NS = 20_000_000_000  # before the last frame: beyond what odometry reaches back


class StampCheck:
    """
    Judges the stamps of frames as they come.

    Attributes
    ----------
    hopped : bool
        The frame is taken, and may turn out to have been ahead of its time.
    returned : bool
        The frame is taken, and the one before was ahead of its time.
    went_back : float
        Seconds by which the frame confirms that time went back; 0: it did not.

    """

    def __init__(self) -> None:
        self.hopped = self.returned = False
        self.went_back = 0.0
        self._last_ns: int | None = None
        self._before_ns: int | None = None  # the hop
        self._apart_ns: int | None = None

    def __str__(self) -> str:
        """Return the stamp of the last frame, and that of a leap to be confirmed."""
        last = 'no frame yet' if self._last_ns is None else f'last frame {self._last_ns} ns'
        if self._apart_ns is None:
            return last
        return f'{last}, {self._apart_ns} ns to be confirmed'

    def is_long_past(self, stamp_ns: int) -> bool:
        """Tell whether a stamp is so far before the last frame that clocks must differ."""
        return self._last_ns is not None and stamp_ns < self._last_ns - LONG_PAST_NS

    def fault(self, stamp_ns: int) -> str:
        """Say why a frame is not taken; nothing where it is."""
        self.hopped = self.returned = False
        self.went_back = 0.0
        last, before = self._last_ns, self._before_ns
        apart, self._apart_ns = self._apart_ns, None
        if last is None:
            self._last_ns = stamp_ns
            return ''
        ahead = stamp_ns - last
        self.returned = ahead < 0 and before is not None and stamp_ns > before
        if not self.returned:
            if -REWIND_NS <= ahead <= 0:
                return f'frame is {-ahead * 1e-6:.1f} ms behind the one before; skipped'
            if not -REWIND_NS <= ahead <= LEAP_NS and (apart is None or stamp_ns <= apart):
                self._apart_ns = stamp_ns
                return (
                    f'frame is {abs(ahead) * 1e-9:.1f} s {"behind" if ahead < 0 else "ahead of"} '
                    'the one before; its time is taken if the next frame follows it'
                )
            self.went_back = max(-ahead, 0) * 1e-9
            self.hopped = ahead > HOP_NS
        self._before_ns = last if self.hopped else None
        self._last_ns = stamp_ns
        return ''
