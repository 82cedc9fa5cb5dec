# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What a diagnostic status, its rules and its levels are."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Severity(IntEnum):
    """Level of a diagnostic status; the numbers are those of diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Rule:
    """
    One condition that is reported.

    Attributes
    ----------
    name : str
        First word of the message.
    level : Severity
        Its severity.
    when : str
        The condition, for the documentation.
    withheld : bool
        Whether no pose is published while it holds.

    """

    name: str
    level: Severity
    when: str
    withheld: bool = True


@dataclass(frozen=True)
class DiagnosticGroup:
    """
    One diagnostic status.

    Attributes
    ----------
    name : str
        As in `<node>: <name>`.
    rules : tuple of Rule
        Its rules in the order of the message; OK if none holds.
    figures : dict
        Key → unit and meaning; an empty unit is a plain number.

    """

    name: str
    rules: tuple[Rule, ...]
    figures: dict[str, tuple[str, str]]
