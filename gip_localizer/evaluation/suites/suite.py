# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What a suite is: parts to try, records of the trials, a table and bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
import math
from typing import Protocol

from gip_localizer.evaluation.suites.conditions import Setup
from gip_localizer.evaluation.suites.trials import Bench, Trial

Cell = str | int | float


@dataclass(frozen=True, eq=False)
class Record:
    """
    One trial.

    Attributes
    ----------
    suite, part : str
        What was tried.
    index : int
        Number of the trial within the part.
    kind : str
        Where the start was, or which method was used; empty where there is one only.
    trial : Trial
        What came of it.
    figures : dict
        More numbers, by name.

    """

    suite: str
    part: str
    index: int
    kind: str
    trial: Trial
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Bound:
    """A demand: the value at most (or at least) the limit; NaN never meets it."""

    row: str
    what: str
    value: float
    limit: float
    at_most: bool = True

    @property
    def met(self) -> bool:
        """Whether the demand is met."""
        return self.value <= self.limit if self.at_most else self.value >= self.limit

    def __str__(self) -> str:
        """Say it in words."""
        sign = 'at most' if self.at_most else 'at least'
        return f'{self.row}: {self.what} {self.value:.4g}, expected {sign} {self.limit:.4g}'


@dataclass(frozen=True)
class Section:
    """
    What a suite found.

    Attributes
    ----------
    name, title : str
        Of the suite.
    columns : sequence of str
        Headings.
    rows : sequence of sequences
        Cells, numbers as numbers.
    bounds : sequence of Bound
        What was demanded.
    notes : sequence of str
        What a reader must know.

    """

    name: str
    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    bounds: Sequence[Bound]
    notes: Sequence[str] = ()


class Suite(Protocol):
    """A set of trials with one purpose."""

    name: str
    title: str

    @property
    def setups(self) -> Mapping[str, Setup]:
        """What is rendered, by part."""

    def count(self, part: str, frames: int) -> int:
        """Return the trials of a part, of the frames that the user asks for."""

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Do one trial."""

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return table and bounds."""


def of_part(records: Sequence[Record], part: str, kind: str | None = None) -> list[Record]:
    """Return the records of a part, and of a kind if one is named."""
    return [r for r in records if r.part == part and kind in (None, r.kind)]


def share(count: int, total: int) -> float:
    """Return a share; NaN of nothing."""
    return count / total if total else math.nan


def ratio(value: float, other: float) -> float:
    """Return a ratio; infinite over zero."""
    return value / other if other else math.inf
