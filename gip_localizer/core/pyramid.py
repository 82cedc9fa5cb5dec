# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The best candidate of a lattice: by scoring all of them, or coarse to fine.

Coarse to fine scores the whole window on joined cells, keeps the best modes, and follows them
down to the lattice's own cells, where the exact residual decides. What comes back is a local
minimum of the exact score. That it is the least of all is measured (`gip bench`), not proven: a
bound from joined cells lets go of the energy inside them, which is most of the noise.

"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gip_localizer.core.field_level import Level
from gip_localizer.core.matching import score_yaws
from gip_localizer.core.pose import Pose2
from gip_localizer.core.probe import Index, Probe
from gip_localizer.core.scoring import Residuals, Scorer

KEPT = (32, 16)  # candidates kept of the whole window, and of each level below
WITHIN = (0.25, 0.15)  # and how far above the best, as shares of the best's depth in the window
FEW = 200  # translations that are scored all rather than on larger cells
LEAST_CELLS = 450  # of the view on the largest joined cells
MOST_JOININGS = 4
CLIMBED = 2  # starts on the lattice's own cells
SHALLOW = 0.004  # a neighbour within this share of the least residual: a valley
LOOSER = 0.8  # joined cells at the edge of the known map may belong to either side
MAX_CLIMB = 20  # rounds of the last climb


@dataclass(frozen=True)
class Winner:
    """
    The best candidate.

    Attributes
    ----------
    index : (int, int, int)
        Of yaw, x and y in the lattice.
    residual : float
        Its weighted mean square; inf where no candidate overlaps the map enough.
    pose : Pose2
        Of base in map.

    """

    index: Index
    residual: float
    pose: Pose2


def exhaustive_winner(level: Level, *, normalized: bool, min_overlap: float) -> Winner:
    """Score every candidate and return the best (the first in order among equals)."""
    least = np.full(len(level.lattice.yaws), np.inf)
    place = np.zeros(len(level.lattice.yaws), np.int64)

    def keep(yaw: int, found: Residuals) -> None:
        place[yaw] = found.residual.argmin()
        least[yaw] = found.residual.flat[place[yaw]]

    scorer = _scorer(level, normalized, min_overlap)
    score_yaws(scorer, level.grid, level.canvas, level.lattice, keep)
    yaw = int(least.argmin())
    x, y = divmod(int(place[yaw]), level.lattice.shape[2])
    return _winner(level, (yaw, x, y), float(least[yaw]))


def pyramid_winner(
    level: Level, *, normalized: bool, min_overlap: float, kept: tuple[int, int] = KEPT
) -> Winner:
    """
    Search coarse to fine.

    Parameters
    ----------
    level : Level
        The finest level.
    normalized, min_overlap
        As for `match`.
    kept : (int, int)
        Modes kept after the whole window, and after each level below it.

    Returns
    -------
    Winner
        The least exact residual among its 26 neighbours on the lattice.

    """
    levels = _levels(level)
    if len(levels) == 1:
        return exhaustive_winner(level, normalized=normalized, min_overlap=min_overlap)
    loose = LOOSER * min_overlap
    modes, depth = _best_of_all(levels[0], normalized, loose, kept[0])
    for above, below in pairwise(levels):
        probe = Probe(below, normalized=normalized,
                      min_overlap=min_overlap if below is level else loose)
        places = list(dict.fromkeys(_below(above, below, mode) for mode in modes))
        if below is level:
            probe.score(places)
            best = _best_known(probe, CLIMBED, np.inf)
            best = [_climb(probe, place) for place in best]
        else:
            probe.score([near for place in places for near in probe.box(place)])
            best = _best_known(probe, kept[1], WITHIN[1] * depth)
        probe.close()
        modes = [_between(probe, place) for place in best]
    if not best:
        return _winner(level, (0, 0, 0), np.inf)
    winner = min(best, key=probe.known.__getitem__)
    return _winner(level, winner, probe.known[winner])


def _levels(level: Level) -> list[Level]:
    """Return the level and those of cells joined two by two, the largest cells first."""
    levels = [level]
    while (
        len(levels) <= MOST_JOININGS
        and levels[0].grid.rows * levels[0].grid.cols >= 4 * LEAST_CELLS
        and levels[0].lattice.shape[1] * levels[0].lattice.shape[2] > FEW
    ):
        levels.insert(0, levels[0].joined(2))
    return levels


def _scorer(level: Level, normalized: bool, min_overlap: float) -> Scorer:
    return Scorer(
        level.values, level.weight, level.window, level.known,
        normalized=normalized, min_overlap=min_overlap, residual_only=True,
    )


def _winner(level: Level, index: Index, residual: float) -> Winner:
    return Winner(index, residual, level.lattice.pose(np.array(index, float)))


Peak = tuple[float, float, float]
"""Index of a mode, between candidates."""


def _best_of_all(
    level: Level, normalized: bool, min_overlap: float, count: int
) -> tuple[list[Peak], float]:
    """Return the best candidates of the whole window, and how deep the best lies."""
    residual = np.empty(level.lattice.shape, np.float32)

    def keep(yaw: int, found: Residuals) -> None:
        residual[yaw] = found.residual

    scorer = _scorer(level, normalized, min_overlap)
    score_yaws(scorer, level.grid, level.canvas, level.lattice, keep)
    flat = residual.ravel()
    count = min(count, flat.size)
    order = np.argpartition(flat, count - 1)[:count]
    least, usual = float(flat[order].min()), float(np.median(flat))
    if not np.isfinite(least):
        return [], 0.0
    depth = usual - least if np.isfinite(usual) else np.inf
    order = np.sort(order[flat[order] <= least + WITHIN[0] * depth])
    places = np.stack(np.unravel_index(order, residual.shape), axis=1)
    return [(float(k), float(i), float(j)) for k, i, j in places], depth


def _best_known(probe: Probe, count: int, above: float) -> list[Index]:
    """Return the best candidates scored so far, at most so far above the best of them."""
    ranked = sorted(probe.known.items(), key=lambda scored: (scored[1], scored[0]))[:count]
    if not ranked or not np.isfinite(ranked[0][1]):
        return []
    return [place for place, residual in ranked if residual <= ranked[0][1] + above]


def _between(probe: Probe, place: Index) -> Peak:
    """Return where a parabola on each axis has its minimum, within half a step."""
    peak = [float(n) for n in place]
    middle = probe.known[place]
    for axis in range(3):
        low, high = (
            probe.known.get((place[0] + s * (axis == 0), place[1] + s * (axis == 1),
                             place[2] + s * (axis == 2)), np.inf) for s in (-1, 1)
        )
        bend = low - 2.0 * middle + high
        if 0.0 < bend < np.inf:
            peak[axis] += min(max(0.5 * (low - high) / bend, -0.5), 0.5)
    return peak[0], peak[1], peak[2]


def _below(above: Level, below: Level, peak: Peak) -> Index:
    """Return the nearest candidate on a finer level."""
    yaws = above.lattice.yaws
    turn = float(np.interp(peak[0], np.arange(len(yaws)), yaws))
    yaw = int(np.abs(below.lattice.yaws - turn).argmin())
    ratio = above.lattice.step / below.lattice.step
    x, y = (
        min(max(round(n + (i - m) * ratio), 0), 2 * n) for i, m, n in
        zip(peak[1:], above.lattice.half, below.lattice.half, strict=True)
    )
    return yaw, x, y


def _climb(probe: Probe, place: Index) -> Index:
    """Go to the best neighbour until there is no better one; in a flat valley, look farther."""
    for _ in range(MAX_CLIMB):
        before = place
        place = probe.best_about(before)
        if place == before and probe.is_shallow(place, SHALLOW):
            place = probe.best_about(before, reach=2)
        if place == before:
            break
    return place
