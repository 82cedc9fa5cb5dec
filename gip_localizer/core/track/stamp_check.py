# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Checks that each frame is newer than the frame before it.

A stamp far from the last one is either a single wrong stamp, or time itself has jumped (a bag that
is played in a loop, a long pause). The next frame decides, so that a single wrong stamp does not
reset the belief. A forward step of less than a minute is accepted at once; if the next frame is
older, the stamp was wrong.

"""

from __future__ import annotations

# Backward step (ns) above which time has restarted; frames of smaller steps are out of order
# (design choice: 1 s, because no transport delays a frame for longer).
REWIND_NS = 1_000_000_000
# Forward step (ns) above which a later frame may show that the stamp was wrong (design choice:
# 0.5 s, because it is several times the period of the slowest cameras).
SUSPECT_STEP_NS = 500_000_000
# Forward step (ns) above which the next frame must confirm the stamp (design choice: 60 s, because
# a camera that works pauses for less).
LEAP_NS = 60_000_000_000
# Age (ns) of a stamp, relative to the last frame, above which it must be of another clock (design
# choice: 20 s, because odometry is kept for as long).
LONG_PAST_NS = 20_000_000_000


class StampCheck:
    """
    Checks the stamps of frames in the order of their arrival.

    Attributes
    ----------
    suspect : bool
        The frame is used, but the next frame may show that its stamp was too late.
    returned : bool
        The frame is used, and shows that the stamp of the frame before was too late.
    went_back : float
        Seconds by which the frame confirms that time went back; 0: it did not.

    """

    def __init__(self) -> None:
        self.suspect = self.returned = False
        self.went_back = 0.0
        self._last_ns: int | None = None
        self._before_ns: int | None = None  # the frame before a suspect step
        self._unconfirmed_ns: int | None = None

    def __str__(self) -> str:
        """Return the stamp of the last frame, and that of a jump that is not confirmed yet."""
        last = 'no frame yet' if self._last_ns is None else f'last frame {self._last_ns} ns'
        if self._unconfirmed_ns is None:
            return last
        return f'{last}, {self._unconfirmed_ns} ns to be confirmed'

    def is_long_past(self, stamp_ns: int) -> bool:
        """Return whether a stamp is so much older than the last frame that its clock differs."""
        return self._last_ns is not None and stamp_ns < self._last_ns - LONG_PAST_NS

    def fault(self, stamp_ns: int) -> str:
        """Return why a frame is not used; an empty string if it is used."""
        self.suspect = self.returned = False
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
            self.suspect = ahead > SUSPECT_STEP_NS
        self._before_ns = last if self.suspect else None
        self._last_ns = stamp_ns
        return ''
