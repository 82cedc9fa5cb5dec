# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""One ROS domain per test process, reserved on this machine as long as the process lives."""

from __future__ import annotations

import fcntl
from functools import cache
import os
from pathlib import Path
import tempfile
from typing import TextIO

FIRST, OTHERS = range(215, 233), range(1, 102)
"""
Domains whose ports lie outside of those that Linux gives to any program (32768 to 60999).
`gip demo` takes one of 1 to 100, so the upper ones come first.
"""


@cache
def own_domain() -> int:
    """Reserve a domain that no other test process of this machine has, of any clone."""
    turn = os.getpid() % len(FIRST)
    for domain in (*FIRST[turn:], *FIRST[:turn], *OTHERS):
        if _lock(Path(tempfile.gettempdir()) / f'gip-test-domain-{domain}.lock'):
            return domain
    raise RuntimeError('every ROS domain is taken by another test process; end some of them')


_HELD: list[TextIO] = []
"""Open files: the system drops their locks when the process ends, however it ends."""


def _lock(path: Path) -> bool:
    try:
        file = path.open('a')
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    _HELD.append(file)
    return True
