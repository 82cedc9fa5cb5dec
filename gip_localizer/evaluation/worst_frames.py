# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Which frames a report shows: the worst of each kind, collected during a run, and why."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
import heapq
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.evaluation.error_table import tabulate_errors
from gip_localizer.evaluation.exhibits import frame_exhibit
from gip_localizer.evaluation.run import FrameExhibit
from gip_localizer.io.trajectory import Trajectory

ERRORS, NEES = 3, 2
"""Number of frames shown for their error (or reported σ), and for their NEES; chosen."""
STATUSES = 4
"""Largest number of statuses of withheld frames of which the first frame is shown; chosen."""
ERROR, SIGMA, CONSISTENCY = 'position error', 'reported standard deviation', 'NEES'


@dataclass
class Ranking:
    """The frames with the largest values so far."""

    count: int
    kept: list[tuple[float, int, FrameExhibit]] = field(default_factory=list)
    seen: int = 0

    def wants(self, value: float) -> bool:
        """Count a value; return whether it is among the largest."""
        self.seen += 1
        return len(self.kept) < self.count or value > self.kept[0][0]

    def keep(self, value: float, number: int, exhibit: FrameExhibit) -> None:
        """Keep a frame; the smallest of the kept ones leaves if there are too many."""
        heapq.heappush(self.kept, (value, -number, exhibit))
        if len(self.kept) > self.count:
            heapq.heappop(self.kept)

    def largest_first(self) -> list[FrameExhibit]:
        """Return the kept frames."""
        ranked = sorted(self.kept, key=lambda entry: (-entry[0], -entry[1]))
        return [exhibit for _, _, exhibit in ranked]


class WorstFrames:
    """
    Keeps the pictures of the worst frames so far.

    These are the published frames with the largest errors (without ground truth: the largest
    reported σ), further ones with the largest NEES, and the first withheld frame of each status.

    Parameters
    ----------
    truth : Trajectory or None
        Ground truth.
    raster_map : RasterMap
        Map for the matched windows.

    """

    def __init__(self, truth: Trajectory | None, raster_map: RasterMap) -> None:
        self._truth = truth
        self._map = raster_map
        self._rankings = {ERROR: Ranking(ERRORS), SIGMA: Ranking(ERRORS),
                          CONSISTENCY: Ranking(ERRORS + NEES)}
        self._withheld: dict[str, FrameExhibit] = {}
        self._statuses: Counter[str] = Counter()
        self._seen = 0
        self._start_ns: int | None = None

    def add(self, image: Callable[[], NDArray[Any] | None], estimate: Estimate) -> None:
        """Add a frame if it is among the worst; `image` is called only then."""
        self._seen += 1
        if self._start_ns is None:
            self._start_ns = estimate.stamp_ns
        status = str(estimate.status)
        if estimate.pose is None:
            self._statuses[status] += 1
            if self._statuses[status] == 1 and len(self._withheld) < STATUSES:
                words = f'{status}, {estimate.reason}'.rstrip(', ')
                self._withheld[status] = self._exhibit(words, image, estimate)
            return
        figures = self._figures(estimate)
        wanted = [name for name, value in figures.items() if self._rankings[name].wants(value)]
        if wanted:
            exhibit = self._exhibit(_in_words(status, figures), image, estimate)
            for name in wanted:
                self._rankings[name].keep(figures[name], self._seen, exhibit)

    def exhibits(self) -> list[FrameExhibit]:
        """Return the kept frames: of the largest errors first, withheld ones last."""
        errors = self._rankings[ERROR]
        first = ERROR if errors.seen else SIGMA
        shown = self._explained(first, ERRORS, ())
        shown += self._explained(CONSISTENCY, NEES, shown)
        return shown + [
            replace(exhibit, why=(
                f'First of {count} frames with {status}.' if (count := self._statuses[status]) > 1
                else f'The only frame with {status}.'
            ))
            for status, exhibit in self._withheld.items()
        ]

    def _explained(
        self, name: str, count: int, shown: list[FrameExhibit] | tuple[()]
    ) -> list[FrameExhibit]:
        """Return frames of a ranking that are not shown yet, with their rank."""
        ranking = self._rankings[name]
        known = {exhibit.title for exhibit in shown}
        return [
            replace(exhibit, why=f'Rank {rank} of {ranking.seen} published frames by {name}.')
            for rank, exhibit in enumerate(ranking.largest_first(), start=1)
            if exhibit.title not in known
        ][:count]

    def _exhibit(
        self, words: str, image: Callable[[], NDArray[Any] | None], estimate: Estimate
    ) -> FrameExhibit:
        assert self._start_ns is not None
        seconds = (estimate.stamp_ns - self._start_ns) * 1e-9
        title = f'Frame {self._seen}, {seconds:.2f} s: {words}'
        return frame_exhibit(title, image(), estimate, self._map)

    def _figures(self, estimate: Estimate) -> dict[str, float]:
        """Return the figures by which a published frame is ranked."""
        table = tabulate_errors([estimate], self._truth)
        values = {ERROR: float(table.xy[0]), CONSISTENCY: float(table.nees[0])}
        if not math.isfinite(values[ERROR]):
            values[SIGMA] = float(np.hypot(table.sigma[0, 0], table.sigma[0, 1]))
        return {name: value for name, value in values.items() if math.isfinite(value)}


def _in_words(status: str, figures: dict[str, float]) -> str:
    words = [status]
    if ERROR in figures:
        words.append(f'error {1e3 * figures[ERROR]:.1f} mm')
    if SIGMA in figures:
        words.append(f'reported sigma {1e3 * figures[SIGMA]:.1f} mm')
    if CONSISTENCY in figures:
        words.append(f'NEES {figures[CONSISTENCY]:.1f}')
    return ', '.join(words)
