# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What an error costs that nobody foresaw: the frame, and not the node."""

from __future__ import annotations

from collections.abc import Callable
import traceback

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.threads import check_end, WorkEndedError


def survived(
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
    try:
        return work()
    except WorkEndedError:
        raise
    except Exception as error:  # a fault of this package, whatever it is
        check_end()  # whose pools break first
        log(traceback.format_exc())
        return Estimate(stamp_ns, Status.FAULT, (
            f'{type(error).__name__}: {error}; a fault of gip_localizer, please report it with '
            'the traceback in the log; the next frame is localized'
        ))
