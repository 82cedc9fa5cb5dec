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

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from gip_localizer.core.field_level import Level
from gip_localizer.core.matching import score_yaws
from gip_localizer.core.pose import Pose2
from gip_localizer.core.probe import Index, Probe
from gip_localizer.core.scoring import Residuals, Scorer

KEPT = (24, 6)  # modes after the whole window, and after each level below
LEAST_CELLS = 450  # of the view on the largest joined cells
MOST_JOININGS = 4
SHALLOW = 0.004  # a neighbour within this share of the least residual: a valley
LOOSER = 0.8  # joined cells at the edge of the known map may belong to either side
MAX_CLIMB = 20  # rounds of the last climb
DEPTH = 0.5  # modes less deep than this share of the deepest, below the median, are dropped
CLIMBED = 2  # starts on the lattice's own cells


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
    modes = _all_modes(levels[0], normalized, loose, kept[0])
    for above, below in pairwise(levels[:-1]):
        modes = _followed(above, below, modes, normalized, loose)[: kept[1]]
    probe = Probe(level, normalized=normalized, min_overlap=min_overlap)
    starts = [_below(levels[-2], level, peak) for peak, _ in modes[:CLIMBED]]
    found = [_climb(probe, start) for start in starts]
    probe.close()
    if not found:
        return _winner(level, (0, 0, 0), np.inf)
    return _winner(level, *min(found, key=lambda each: each[1]))


def _levels(level: Level) -> list[Level]:
    """Return the level and those of cells joined two by two, the largest cells first."""
    levels = [level]
    while (
        len(levels) <= MOST_JOININGS
        and levels[0].grid.rows * levels[0].grid.cols >= 4 * LEAST_CELLS
        and max(levels[0].lattice.half) >= 4
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
Mode = tuple[Peak, float]


def _all_modes(level: Level, normalized: bool, min_overlap: float, count: int) -> list[Mode]:
    """Return the best local minima of the whole window, best first."""
    residual = np.empty(level.lattice.shape, np.float32)

    def keep(yaw: int, found: Residuals) -> None:
        residual[yaw] = found.residual

    scorer = _scorer(level, normalized, min_overlap)
    score_yaws(scorer, level.grid, level.canvas, level.lattice, keep)
    lowest = np.stack([cv2.erode(plane, np.ones((3, 3), np.uint8)) for plane in residual])
    least = lowest.copy()
    least[1:] = np.minimum(least[1:], lowest[:-1])
    least[:-1] = np.minimum(least[:-1], lowest[1:])
    flat = np.flatnonzero((residual <= least) & np.isfinite(residual))
    order = flat[np.argsort(residual.flat[flat], kind='stable')[:count]]
    if len(order):
        best, usual = float(residual.flat[order[0]]), float(np.median(residual))
        if np.isfinite(usual):
            order = order[residual.flat[order] <= best + (1.0 - DEPTH) * (usual - best)]
    places = np.stack(np.unravel_index(order, residual.shape), axis=1).tolist()
    return [
        (_between(lambda place: float(residual[place]), (k, i, j), residual.shape),
         float(residual[k, i, j]))
        for k, i, j in places
    ]


def _between(residual: Callable[[Index], float], place: Index, shape: Index) -> Peak:
    """Return where a parabola on each axis has its minimum, within half a step."""
    peak = [float(n) for n in place]
    middle = residual(place)
    for axis, last in enumerate(shape):
        if not 0 < place[axis] < last - 1:
            continue
        low, high = (
            residual((place[0] + s * (axis == 0), place[1] + s * (axis == 1),
                      place[2] + s * (axis == 2))) for s in (-1, 1)
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


def _followed(
    above: Level, below: Level, modes: list[Mode], normalized: bool, min_overlap: float
) -> list[Mode]:
    """Return the modes at the finer level, each at the best of its neighbours, best first."""
    probe = Probe(below, normalized=normalized, min_overlap=min_overlap)
    boxes = [probe.box(_below(above, below, index)) for index, _ in modes]
    probe.score([place for box in boxes for place in box])
    probe.close()
    known, shape = probe.known, below.lattice.shape
    found = sorted({min(box, key=known.__getitem__) for box in boxes}, key=known.__getitem__)
    return [
        (_between(lambda near: known.get(near, np.inf), place, shape), known[place])
        for place in found
    ]


def _climb(probe: Probe, place: Index) -> tuple[Index, float]:
    """Go to the best neighbour until there is no better one; in a flat valley, look farther."""
    for _ in range(MAX_CLIMB):
        before = place
        place = probe.best_about(before)
        if place == before and probe.is_shallow(place, SHALLOW):
            place = probe.best_about(before, reach=2)
        if place == before:
            break
    return place, probe.known[place]
