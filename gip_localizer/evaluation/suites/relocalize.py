# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `relocalize`: search the whole map without a prior until a pose is published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from gip_localizer.core.localizer import Localizer
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.evaluation.suites.conditions import CLEAR, NIGHT, Setup
from gip_localizer.evaluation.suites.suite import Bound, Cell, of_part, Record, Section, share
from gip_localizer.evaluation.suites.trials import Bench, compared, localized, Trial

START_NS = 10**15
"""Stamp of the first trial, nanoseconds; chosen."""
APART_NS = 10**10
"""Time, in nanoseconds, by which each trial lies before the previous one; chosen."""
MOST_FRAMES = 8
"""Largest number of images per trial; chosen."""
TRIES, FEW_TRIES = 100, 10
"""Largest number of trials of the bounded condition, and of the others; chosen."""
SETUPS = (
    replace(CLEAR, name='clear', localizer={'motion.fuse': True}),
    replace(NIGHT, name='night', localizer={'motion.fuse': True}),
    replace(CLEAR, name='paint alone', ground='poor', localizer={'motion.fuse': True}),
)
BOUNDED = 'clear'
FOUND_AT_LEAST = 0.9
"""Least fraction of right trials of the bounded condition; chosen."""


class Relocalize:
    """`~/relocalize` without a prior, then at most `MOST_FRAMES` frames with odometry."""

    name = 'relocalize'
    title = 'Relocalization in a map of 60 x 40 m without a prior'
    columns = ('condition', 'trials', 'right', 'no pose', 'wrong', 'largest error [mm]',
               'frames until found', 'search [ms]')

    @property
    def setups(self) -> Mapping[str, Setup]:
        """Setups by name."""
        return {setup.name: setup for setup in SETUPS}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per setup; rare failures need many trials."""
        return min(4 * frames, TRIES if part == BOUNDED else FEW_TRIES)

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Search, then track until a pose is published or `MOST_FRAMES` is reached."""
        rng = bench.rng(index)
        drive = bench.drive
        first = int(rng.integers(0, 100_000))
        origin = drive.truth(first).inverse()
        start = START_NS - index * APART_NS
        localizer = _localizer(bench)
        localizer.relocalize()
        search_ms = 0.0
        for count in range(MOST_FRAMES):
            frame = drive.frame(first + count)
            stamp = start + frame.stamp_ns - drive.stamp_ns(first)
            localizer.add_odometry(OdometrySample(
                stamp, origin @ frame.truth, drive.parameters.drive.speed
            ))
            estimate = localized(localizer, stamp, frame.image, drive.camera)
            search_ms = max(search_ms, estimate.timings_ms.get('match', 0.0))
            if estimate.published:
                break
        trial = compared(estimate, frame.truth)
        return [Record(self.name, part, index, '', trial,
                       {'frames': count + 1.0, 'search_ms': search_ms})]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return a row per condition."""
        rows = [_row(s.name, of_part(records, s.name)) for s in SETUPS]
        demands = []
        for setup in SETUPS:
            trials = [r.trial for r in of_part(records, setup.name)]
            demands.append(Bound(setup.name, 'wrong poses', sum(t.wrong for t in trials), 0))
            if setup.name == BOUNDED:
                found = share(sum(_right(t) for t in trials), len(trials))
                demands.append(
                    Bound(setup.name, 'fraction found', found, FOUND_AT_LEAST, at_most=False)
                )
        return Section(self.name, self.title, self.columns, rows, demands, (
            f'A trial ends with the first pose, or after {MOST_FRAMES} frames at 10 Hz; for the '
            'first frame every position and heading of the map is searched.',
        ))


@lru_cache(maxsize=1)
def _localizer(bench: Bench) -> Localizer:
    return Localizer(bench.raster_map, bench.parameters)


def _right(trial: Trial) -> bool:
    return trial.error is not None and not trial.wrong


def _row(name: str, records: Sequence[Record]) -> list[Cell]:
    right = [r for r in records if _right(r.trial)]
    errors = [float(np.hypot(*r.trial.error[:2])) for r in right if r.trial.error is not None]
    return [
        name, len(records), len(right), sum(r.trial.error is None for r in records),
        sum(r.trial.wrong for r in records),
        round(1e3 * max(errors), 1) if errors else float('nan'),
        round(float(np.mean([r.figures['frames'] for r in right])), 1) if right else '-',
        round(float(np.median([r.figures['search_ms'] for r in records]))) if records else '-',
    ]
