# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""When a drive begins and ends, though single messages were logged at 0 or at the end of time."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

NS_PER_DAY = 86_400 * 10**9
LONGEST = 30 * NS_PER_DAY
"""No drive is longer, nanoseconds: a bag that seems to be is looked at message by message."""
APART = NS_PER_DAY
"""Log times farther from their neighbours are of another clock."""
LEAST_SHARE = 0.9
"""Share of the messages that must be left for the others to be strays."""


def drive_times(start_ns: int, end_ns: int,
                logged: Callable[[], Iterable[int]]) -> tuple[int, int, str]:
    """
    Return first and last log time of the drive, and what is to be said of messages outside.

    Parameters
    ----------
    start_ns, end_ns : int
        First and last log time of all messages, nanoseconds.
    logged : callable
        Returns the log times of all messages; called only where the span cannot be.

    """
    if end_ns - start_ns <= LONGEST:
        return start_ns, end_ns, ''
    times = np.sort(np.fromiter(logged(), np.uint64))
    if not len(times):
        return start_ns, end_ns, ''
    edges = np.flatnonzero(np.diff(times) > APART) + 1
    drive = max(np.split(times, edges), key=len)
    strays = len(times) - len(drive)
    first, last = int(drive[0]), int(drive[-1])
    if len(drive) < LEAST_SHARE * len(times):
        return start_ns, end_ns, ''
    stray = start_ns if start_ns < first else end_ns
    return first, last, (
        f'{strays} of {len(times)} messages are logged at other times (one at '
        f'{stray * 1e-9:.3f} s) than the drive, {first * 1e-9:.3f} to {last * 1e-9:.3f} s; '
        '--start counts from its begin'
    )
