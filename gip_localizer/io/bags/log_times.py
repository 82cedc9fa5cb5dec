# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Start and end of a drive, without single messages that have wrong log times."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

NS_PER_DAY = 86_400 * 10**9
"""Nanoseconds per day."""
LONGEST = 30 * NS_PER_DAY
"""Longest duration (ns) of a drive; chosen: for a longer bag, all log times are examined."""
APART = NS_PER_DAY
"""Gap (ns) between log times from which they come from different clocks; chosen."""
LEAST_SHARE = 0.9
"""Least share (no unit) of messages in the drive for ignoring the others; chosen."""


def drive_times(start_ns: int, end_ns: int,
                logged: Callable[[], Iterable[int]]) -> tuple[int, int, str]:
    """
    Return first and last log time of the drive, and a warning about messages outside.

    Parameters
    ----------
    start_ns, end_ns : int
        First and last log time of all messages, nanoseconds.
    logged : callable
        Returns the log times of all messages; called only if the span is too long.

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
        '--start counts from the start of the drive'
    )
