# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Guard against unexpected exceptions: they cost one frame, not the frames after it."""

from __future__ import annotations

from collections.abc import Callable
import traceback

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.threads import check_end, WorkEndedError


def run_guarded(
    work: Callable[[], Estimate], stamp_ns: int, log: Callable[[str], object]
) -> Estimate:
    """
    Localize a frame; return an estimate with status FAULT after an unexpected exception.

    Parameters
    ----------
    work : callable
        Localizes the frame.
    stamp_ns : int
        Stamp of the frame, nanoseconds.
    log : callable
        Receives the traceback.

    Returns
    -------
    Estimate
        Result of the frame; FAULT without a pose if the work raised an exception.

    Raises
    ------
    WorkEndedError
        The process is ending.

    """
    found: list[Estimate] = []
    fault = fault_of(lambda: found.append(work()), log)
    if fault:
        return Estimate(stamp_ns, Status.FAULT, f'{fault}; the next frame is localized')
    return found[0]


def fault_of(work: Callable[[], object], log: Callable[[str], object]) -> str:
    """Call `work`; return the text of its exception, or  (`log`, errors: `run_guarded`)."""
    try:
        work()
    except WorkEndedError:
        raise
    except Exception as error:  # any fault of this package
        check_end()  # thread pools fail first when the process ends
        log(traceback.format_exc())
        return (
            f'{type(error).__name__}: {error}; a fault of gip_localizer, please report it with '
            'the traceback in the log'
        )
    return ''
