# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What an error costs that nobody foresaw: the frame, and not those that follow."""

from __future__ import annotations

from collections.abc import Callable
import traceback

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.threads import check_end, WorkEndedError


def run_guarded(
    work: Callable[[], Estimate], stamp_ns: int, log: Callable[[str], object]
) -> Estimate:
    """
    Localize, and say so where that raises.

    Parameters
    ----------
    work : callable
        Localizes the frame.
    stamp_ns : int
        Of the frame, nanoseconds.
    log : callable
        Takes the traceback.

    Returns
    -------
    Estimate
        Of the frame; FAULT, without a pose, where the work raised.

    Raises
    ------
    WorkEndedError
        The process ends.

    """
    found: list[Estimate] = []
    told = fault_of(lambda: found.append(work()), log)
    if told:
        return Estimate(stamp_ns, Status.FAULT, f'{told}; the next frame is localized')
    return found[0]


def fault_of(work: Callable[[], object], log: Callable[[str], object]) -> str:
    """Do some work; say what it raised, empty: nothing (`log`, WorkEndedError: as above)."""
    try:
        work()
    except WorkEndedError:
        raise
    except Exception as error:  # a fault of this package, whatever it is
        check_end()  # whose pools break first
        log(traceback.format_exc())
        return (
            f'{type(error).__name__}: {error}; a fault of gip_localizer, please report it with '
            'the traceback in the log'
        )
    return ''
