# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The content of one diagnostic status."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.session.diagnostic_types import DiagnosticGroup, Rule, Severity


@dataclass(frozen=True)
class Report:
    """Status of one group: the rules that hold, most important first, and its figures."""

    group: DiagnosticGroup
    rules: tuple[Rule, ...]
    message: str
    figures: dict[str, str]

    @property
    def rule(self) -> Rule | None:
        """The first that holds."""
        return next(iter(self.rules), None)

    @property
    def level(self) -> Severity:
        """The worst of the rules; OK without any."""
        return max((rule.level for rule in self.rules), default=Severity.OK)
