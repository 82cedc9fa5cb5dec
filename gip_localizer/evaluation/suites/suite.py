# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The parts of a suite: setups, records of trials, a result table and bounds."""

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
        Name of the suite and of its setup.
    index : int
        Number of the trial within the setup.
    kind : str
        Kind of start or method; empty if there is only one.
    trial : Trial
        Result of the trial.
    figures : dict
        Further numbers by name.

    """

    suite: str
    part: str
    index: int
    kind: str
    trial: Trial
    figures: dict[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Bound:
    """A bound: the value must be at most (or at least) the limit; NaN misses it."""

    row: str
    what: str
    value: float
    limit: float
    at_most: bool = True

    @property
    def met(self) -> bool:
        """True if the bound is met."""
        return self.value <= self.limit if self.at_most else self.value >= self.limit

    def __str__(self) -> str:
        """Return the bound as a sentence."""
        sign = 'at most' if self.at_most else 'at least'
        return f'{self.row}: {self.what} {self.value:.4g}, expected {sign} {self.limit:.4g}'


@dataclass(frozen=True)
class Section:
    """
    The results of a suite.

    Attributes
    ----------
    name, title : str
        Name and title of the suite.
    columns : sequence of str
        Headings of the table.
    rows : sequence of sequences
        Cells of the table; numbers are not converted to text.
    bounds : sequence of Bound
        The bounds, met or missed.
    notes : sequence of str
        Explanations for the reader.

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
        """Setups by name."""

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials of a setup for the `--frames` of the user."""

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Run one trial."""

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return table and bounds."""


def of_part(records: Sequence[Record], part: str, kind: str | None = None) -> list[Record]:
    """Return the records of a setup, and of a kind if one is given."""
    return [r for r in records if r.part == part and kind in (None, r.kind)]


def share(count: int, total: int) -> float:
    """Return count / total; NaN if total is 0."""
    return count / total if total else math.nan


def ratio(value: float, other: float) -> float:
    """Return value / other; inf if other is 0."""
    return value / other if other else math.inf
