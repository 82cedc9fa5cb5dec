# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `lane`: on a straight lane without features the position along it is not observable."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math

import numpy as np

from gip_localizer.evaluation.suites.conditions import CLEAR, Setup
from gip_localizer.evaluation.suites.suite import Bound, Cell, of_part, Record, Section, share
from gip_localizer.evaluation.suites.trials import Bench, Spread, Trial

LANE = replace(CLEAR, name='featureless lane', ground='lane')
SETUPS = (LANE, replace(CLEAR, name='road'))
LEFT_M = 0.02
"""Largest lateral sigma on the lane, metres; chosen."""
GROWTH = 10.0
"""Least ratio (no unit) of the longitudinal sigma on the lane to that on the road; chosen."""
MOST_FRAMES = 60
"""Largest number of frames per setup; chosen."""


class Lane:
    """A lane between two solid lines without other features, compared with the road."""

    name = 'lane'
    title = 'A straight lane between two solid lines, no texture'
    columns = ('ground', 'frames', 'published', 'sigma ahead [mm]', 'error ahead [mm]',
               'sigma left [mm]', 'error left [mm]', 'sigma yaw [deg]', 'error yaw [deg]')

    @property
    def setups(self) -> Mapping[str, Setup]:
        """Setups of lane and road by name."""
        return {setup.name: setup for setup in SETUPS}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per setup."""
        return min(frames, MOST_FRAMES)

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame."""
        return [Record(self.name, part, index, '', bench.trial(index, Spread()))]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return the rows of lane and road, and the bounds on the lane."""
        lane = [r.trial for r in of_part(records, LANE.name)]
        road = [r.trial for r in of_part(records, SETUPS[1].name)]
        rows = [_row(LANE.name, lane), _row(SETUPS[1].name, road)]
        published = [t for t in lane if t.error is not None]
        bold = [t for t in published if t.covariance is not None and t.error is not None
                and abs(t.error[0]) > 3.0 * math.sqrt(t.covariance[0, 0])]
        growth = _median(lane, 'sigma_ahead_m') / _median(road, 'sigma_ahead_m')
        return Section(self.name, self.title, self.columns, rows, [
            Bound(LANE.name, 'published poses beyond 3 sigma ahead',
                  share(len(bold), len(lane)), 0.0),
            Bound(LANE.name, 'sigma ahead relative to the road',
                  math.inf if not published else growth, GROWTH, at_most=False),
            Bound(LANE.name, 'sigma left [mm]', 1e3 * _median(lane, 'sigma_left_m'),
                  1e3 * LEFT_M),
        ], ('All matches count, published or not: medians of sigma, root mean squares of errors. '
            'If no pose is published on the lane, the bound on its sigma ahead counts as met.',))


def _median(trials: Sequence[Trial], name: str) -> float:
    values = [t.quality[name] for t in trials if name in t.quality]
    return float(np.median(values)) if values else math.nan


def _row(name: str, trials: Sequence[Trial]) -> list[Cell]:
    raw = np.array([t.raw_error for t in trials if t.raw_error is not None]).reshape(-1, 3)
    rms = np.sqrt((raw**2).mean(axis=0)) if len(raw) else np.full(3, math.nan)
    published = share(sum(t.error is not None for t in trials), len(trials))
    return [
        name, len(trials), f'{published:.1%}',
        round(1e3 * _median(trials, 'sigma_ahead_m'), 2), round(1e3 * float(rms[0]), 2),
        round(1e3 * _median(trials, 'sigma_left_m'), 2), round(1e3 * float(rms[1]), 2),
        round(math.degrees(_median(trials, 'sigma_yaw_rad')), 4),
        round(math.degrees(rms[2]), 4),
    ]
