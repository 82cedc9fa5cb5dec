# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""One check of `gip doctor`: what was found, and what to do where it is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Check:
    """
    The outcome of a check.

    Attributes
    ----------
    name : str
        What was checked.
    found : str
        What was found.
    remedy : str
        What to do; empty: the check is passed.

    """

    name: str
    found: str
    remedy: str = ''

    @property
    def passed(self) -> bool:
        """True if nothing is to be done."""
        return not self.remedy

    def lines(self) -> str:
        """Return the check as one line, and its remedy as a second one."""
        line = f'{"PASS" if self.passed else "FAIL"}  {self.name:<14} {self.found}'
        return line if self.passed else f'{line}\n      remedy: {self.remedy}'


def summary_line(checks: Sequence[Check]) -> str:
    """Return the last line of a report."""
    failed = [check.name for check in checks if not check.passed]
    if not failed:
        return f'all {len(checks)} checks passed'
    return f'{len(failed)} of {len(checks)} checks failed: {", ".join(failed)}'
