# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `integrity`: every second frame starts at a wrong place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.suites import protection
from gip_localizer.evaluation.suites.conditions import (
    CARS,
    CHANGED,
    CLEAR,
    DISTORTED,
    NIGHT,
    Setup,
    TILES,
)
from gip_localizer.evaluation.suites.suite import Bound, Cell, of_part, Record, Section, share
from gip_localizer.evaluation.suites.trials import Bench, compared, is_wrong, Spread, Trial

RICH = (
    CLEAR, NIGHT, DISTORTED, CHANGED, TILES,
    replace(CLEAR, name='clear, noisy map', map_noise=0.05),
    replace(NIGHT, name='night, noisy map', map_noise=0.05),
)
POOR = (
    replace(CLEAR, name='paint alone', ground='poor'),
    replace(NIGHT, name='paint alone, night', ground='poor'),
)
POOR_NOISY = replace(CLEAR, name='paint alone, noisy map', ground='poor', map_noise=0.05)
"""Setups; noisy maps have errors of 0.05 of full scale; chosen."""
REPEATED = replace(CLEAR, name='repeated texture', ground='repeated')
RICH_NAME, POOR_NAME = 'rich texture', 'poor texture'
GROUPS: dict[str, tuple[Setup, ...]] = {
    RICH_NAME: RICH, POOR_NAME: POOR, 'poor texture, noisy map': (POOR_NOISY,),
    'repeated texture': (REPEATED,), 'behind cars': (CARS,),
}
"""Setups by group; for the first two groups the fraction of withheld right matches is bounded."""
MOST_WITHHELD = {RICH_NAME: 0.01, POOR_NAME: 0.1}
"""Largest fractions of right matches that the localizer may withhold, by group; chosen."""
RIGHT = 'right'
WRONG_KINDS = ('outside the window', 'another street', 'off the map', 'beside the road')
AHEAD_M, ASIDE_M, TURN = (1.5, 5.0), 0.5, 0.05
"""Offsets (m, m, rad) of starts outside the window: range ahead, largest left and yaw; chosen."""
FAR_M = 5.0
"""Least distance of a start at another street, metres; chosen."""
OFF_M, ROADSIDE_M = (2.0, 20.0), (6.0, 12.0)
"""Ranges of the distance from the map's edge and from the lane, metres; chosen."""
LEAST_WITHHELD, MOST_LOST = 0.95, 0.01
"""Required separation: least fraction of wrong starts withheld, largest of right lost; chosen."""


class IntegritySuite:
    """Right and wrong starts alternate; the wrong ones alternate between their kinds."""

    name = 'integrity'
    title = 'Right and wrong starts'
    columns = (
        'set', 'right starts', 'right withheld', 'wrong starts', 'wrong withheld',
        'wrong poses', 'best separation: right lost at 95 % withheld',
    )

    @property
    def setups(self) -> Mapping[str, Setup]:
        """Setups by name."""
        return {setup.name: setup for group in GROUPS.values() for setup in group}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per setup."""
        return frames

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame from a start whose kind depends on the index."""
        rng = bench.rng(index)
        frame = bench.frame(rng)
        kind = kind_of(part, index)
        start = wrong_start(kind, frame.truth, bench, rng)
        estimate = bench.localize(frame.image, start, Spread().covariance)
        return [Record(self.name, part, index, kind, compared(estimate, frame.truth))]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return a row per group and per setup."""
        rows: list[Sequence[Cell]] = []
        demands: list[Bound] = []
        for group, setups in GROUPS.items():
            of_group = [r for s in setups for r in of_part(records, s.name)]
            rows.append(_row(group.upper(), of_group))
            demands += _bounds(group, of_group)
            if len(setups) > 1:
                rows += [_row('  ' + s.name, of_part(records, s.name)) for s in setups]
        kinds = [(f'any: {kind}', [r for r in records if r.kind == kind]) for kind in WRONG_KINDS]
        rows += [_row(*kind) for kind in kinds]
        trials = [r.trial for r in records]
        demands += protection.misleading_bounds('protection level', trials)
        return Section(self.name, self.title, self.columns, rows, demands, (
            *protection.notes(trials),
            'A start is right if its window holds the truth. A wrong start counts as withheld if '
            'no wrong pose is published from it, a right one if no pose is published.',
            'Repeated ground has several equal places in every window, so every start is wrong.',
            'Best separation: with a limit on the confidence that withholds 95 % of the wrong '
            'matches, the fraction of right matches below this limit.',
        ))


def kind_of(part: str, index: int) -> str:
    """Return the kind of start of a trial."""
    if part == REPEATED.name:
        return 'repeated'
    return RIGHT if index % 2 == 0 else WRONG_KINDS[index // 2 % len(WRONG_KINDS)]


def wrong_start(kind: str, truth: Pose2, bench: Bench, rng: np.random.Generator) -> Pose2:
    """Draw a start of a kind; the kinds `right` and `repeated` are near the truth."""
    if kind == 'outside the window':
        ahead = float(rng.choice([-1.0, 1.0])) * rng.uniform(*AHEAD_M)
        aside, turn = rng.uniform(-ASIDE_M, ASIDE_M), rng.uniform(-TURN, TURN)
        return truth @ Pose2(float(ahead), float(aside), float(turn))
    if kind == 'another street':
        while True:
            other = bench.drive.motion.pose(float(rng.uniform(0.0, 1e4)))
            if truth.distance(other) > FAR_M:
                return other
    if kind == 'beside the road':
        aside = float(rng.choice([-1.0, 1.0])) * rng.uniform(*ROADSIDE_M)
        return truth @ Pose2(0.0, float(aside), float(rng.uniform(-np.pi, np.pi)))
    if kind == 'off the map':
        return _off_map(bench, rng)
    return truth @ Spread().offset(rng)


def _off_map(bench: Bench, rng: np.random.Generator) -> Pose2:
    """Draw a pose at a distance of `OFF_M` outside the map's edge."""
    width, height = bench.raster_map.size_m
    out = float(rng.uniform(*OFF_M))
    along_x, along_y = float(rng.uniform(0.0, width)), float(rng.uniform(0.0, height))
    places = ((-out, along_y), (width + out, along_y), (along_x, -out), (along_x, height + out))
    x, y = places[int(rng.integers(4))]
    return bench.raster_map.origin @ Pose2(x, y, float(rng.uniform(-np.pi, np.pi)))


def _row(name: str, records: Sequence[Record]) -> list[Cell]:
    right = [r.trial for r in records if r.kind == RIGHT]
    wrong = [r.trial for r in records if r.kind != RIGHT]
    return [
        name, len(right), _percent(share(sum(t.error is None for t in right), len(right))),
        len(wrong), _percent(share(sum(not t.wrong for t in wrong), len(wrong))),
        sum(r.trial.wrong for r in records), _percent(lost_at(records, LEAST_WITHHELD)),
    ]


def _percent(value: float) -> str:
    return f'{value:.1%}' if np.isfinite(value) else '-'


def confidences(records: Sequence[Record], *, right: bool) -> np.ndarray:  # type: ignore[type-arg]
    """Return the confidence of right matches from right starts, or of wrong matches; 0: none."""
    chosen = [
        r.trial for r in records
        if (r.kind == RIGHT) == right
        and (r.trial.raw_error is None or is_wrong(r.trial.raw_error) != right)
    ]
    return np.array([t.quality.get('confidence', 0.0) for t in chosen])


def lost_at(records: Sequence[Record], withheld: float) -> float:
    """Return the fraction of right matches lost by a limit that withholds enough wrong ones."""
    right, wrong = confidences(records, right=True), confidences(records, right=False)
    if not len(right) or not len(wrong):
        return float('nan')
    limit = np.quantile(wrong, withheld, method='higher')
    return float(np.mean(right <= limit)) if limit > 0.0 else float(np.mean(right <= 0.0))


def _bounds(group: str, records: Sequence[Record]) -> list[Bound]:
    wrong = [r.trial for r in records if r.kind != RIGHT]
    demands = [
        Bound(group, 'wrong poses published', sum(r.trial.wrong for r in records), 0),
        Bound(group, 'fraction of wrong starts withheld',
              share(sum(not t.wrong for t in wrong), len(wrong)), LEAST_WITHHELD, at_most=False),
    ]
    if group in MOST_WITHHELD:
        right = _right_fixes(records)
        lost = share(sum(t.error is None for t in right), len(right))
        demands += [
            Bound(group, f'fraction of right matches lost with {LEAST_WITHHELD:.0%} of wrong '
                  'ones withheld', lost_at(records, LEAST_WITHHELD), MOST_LOST),
            Bound(group, 'fraction of right matches withheld', lost, MOST_WITHHELD[group]),
        ]
    return demands


def _right_fixes(records: Sequence[Record]) -> list[Trial]:
    """Return the trials whose best match, published or not, is right."""
    return [
        r.trial for r in records
        if r.kind == RIGHT and r.trial.raw_error is not None and not is_wrong(r.trial.raw_error)
    ]
