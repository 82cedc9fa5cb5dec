# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Progress of a verb: live on a terminal, a line now and then in a log file."""

from __future__ import annotations

import sys
from typing import Any

LIVE, LOGGED = 0.1, 30.0
"""Time (s) between two updates on a terminal and in a log file; chosen."""


def progress(total: float | None, what: str, *, unit: str = 'frame', **how: Any) -> Any:
    """
    Return a progress bar on stderr, to be used as a context manager.

    Parameters
    ----------
    total : float or None
        Number of units; None or 0: unknown.
    what : str
        Heading.
    unit : str
        What is counted.
    **how
        Further arguments of `tqdm`.

    """
    from tqdm import tqdm

    live = sys.stderr.isatty()
    return tqdm(
        total=total or None, desc=what, unit=unit, file=sys.stderr,
        mininterval=LIVE if live else LOGGED, delay=0.0 if live else LOGGED, **how,
    )
