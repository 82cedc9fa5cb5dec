# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Which frames are taken: each one that is newer than the frame before it.

A stamp far from the last one may be a single wrong one, or time itself may have leapt (a bag in
a loop, a long pause): only the next frame tells, so that a wrong stamp costs no belief.

"""

from __future__ import annotations

REWIND_NS = 1_000_000_000  # a step back in time by more than this is a restart, not disorder
LEAP_NS = 60_000_000_000  # a step ahead by more than this must be confirmed


class FrameOrder:
    """
    Judges the stamps of frames as they come.

    Attributes
    ----------
    restarted : bool
        The last frame that was taken confirmed that time went back.

    """

    def __init__(self) -> None:
        self.restarted = False
        self._last_ns: int | None = None
        self._apart_ns: int | None = None

    def fault(self, stamp_ns: int) -> str:
        """Say why a frame is not taken; nothing where it is."""
        self.restarted = False
        if self._last_ns is None:
            self._last_ns = stamp_ns
            return ''
        ahead = stamp_ns - self._last_ns
        apart, self._apart_ns = self._apart_ns, None
        if -REWIND_NS <= ahead <= 0:
            return f'frame is {-ahead * 1e-6:.1f} ms behind the one before; skipped'
        if ahead < 0 or ahead > LEAP_NS:
            if apart is None or stamp_ns <= apart:
                self._apart_ns = stamp_ns
                return (
                    f'frame is {abs(ahead) * 1e-9:.1f} s {"behind" if ahead < 0 else "ahead of"} '
                    'the one before; its time is taken if the next frame follows it'
                )
            self.restarted = ahead < 0
        self._last_ns = stamp_ns
        return ''
