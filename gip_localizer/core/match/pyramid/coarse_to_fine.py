# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The best candidate of a lattice: by scoring all of them, or coarse to fine.

Coarse to fine scores the whole window on larger cells, keeps the best modes, and follows them
down to the lattice's own cells, where the exact residual decides. What comes back is a local
minimum of the exact score. That it is the least of all is measured (`gip bench`), not proven: a
bound from larger cells lets go of the energy inside them, which is most of the noise. Where the
best of the larger cells does not stand out from the noise, all candidates are scored.

For callers that need the winner alone: the localizer reads its posterior off the whole surface,
and scores that on larger cells (`search`).

"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
import math

import cv2
import numpy as np

from gip_localizer.core.match.lattice import Index
from gip_localizer.core.match.peaks import Mode, modes_of, Peak, ResidualLookup
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.match.pyramid.local_scores import LocalScores
from gip_localizer.core.match.score_surface import score_yaws
from gip_localizer.core.match.scoring import Residuals, Scorer
from gip_localizer.core.pose import Pose2

KEPT = (32, 16)  # modes kept of the whole window, and of each level below
WITHIN = (0.35, 0.15, 0.2)  # over the best, as shares of its depth in the window; last: climbs
FEW = 200  # translations that are scored all rather than on larger cells
LEAST_CELLS = 450  # of the view on the largest cells
MOST_DOWNSAMPLINGS = 4  # levels above the finest one; chosen
CLIMBED = 4  # starts on the lattice's own cells
SHALLOW = 0.004  # a neighbour within this share of the least residual: a valley
LOOSER = 0.8  # larger cells at the edge of the known map may belong to either side
MAX_CLIMB = 20  # rounds of the last climb
SMALL_WINDOW = 1.5  # times the turned view: a window prepared once for all climbs
REACH = 4  # translations about a start that are prepared for its climb
DOUBT = 500.0  # log likelihood ratio, below which larger cells have been seen to hide the best
MOST_IN_DOUBT = 5_000_000  # candidates that are all scored in doubt
CROWD = 4  # candidates looked at per mode kept
MOST_OF_A_CLIMB = 27  # candidates that a climb scores about its end
BLOCK_CANDIDATES = 16_000_000  # of the largest cells, scored at once: 64 MB of float32
LEAST_YAWS = 12  # of a block, of which two more are scored to compare its first and last


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

    def keep(yaws: slice, found: Residuals) -> None:
        flat = found.residual.reshape(len(found.residual), -1)
        place[yaws] = flat.argmin(axis=1)
        least[yaws] = flat[np.arange(len(flat)), place[yaws]]

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
    count = kept[0] if len(levels) > 2 else min(2 * CLIMBED, kept[0])
    modes, depth = _descend(levels, normalized, min_overlap, (count, kept[1]), WITHIN[0])
    places = [place for value, place in modes[:CLIMBED]
              if value <= modes[0][0] + WITHIN[2] * depth]
    known = _climbs(level, places, normalized, min_overlap)
    if not known:
        return _winner(level, (0, 0, 0), np.inf)
    winner = min(known, key=lambda place: (known[place], place))
    if _in_doubt(level, depth, known[winner]):
        return exhaustive_winner(level, normalized=normalized, min_overlap=min_overlap)
    return _winner(level, winner, known[winner])


def pyramid_modes(
    level: Level, *, normalized: bool, min_overlap: float, count: int,
    kept: tuple[int, int], within: float,
) -> list[tuple[float, Pose2]]:
    """
    Search coarse to fine for places that are better than all about them.

    Parameters
    ----------
    level, normalized, min_overlap, kept
        As for `pyramid_winner`.
    count : int
        Most places that are returned.
    within : float
        How much worse than the best, as a share of its depth, a mode of the largest cells may be.

    Returns
    -------
    list of (float, Pose2)
        Exact residual, and pose between the candidates; best first, none twice.

    """
    levels = _levels(level)
    modes, _ = _descend(levels, normalized, min_overlap, kept, within)
    known = _climbs(level, [place for _, place in modes], normalized, min_overlap)
    order = sorted(known, key=lambda place: (known[place], place))
    finite = np.array([place for place in order if np.isfinite(known[place])])
    if not len(finite):
        return []
    finite = finite[: MOST_OF_A_CLIMB * count]
    return [(value, level.lattice.pose(np.array(peak)))
            for value, peak in modes_of(finite, known, count)]


def _descend(
    levels: list[Level], normalized: bool, min_overlap: float, kept: tuple[int, int],
    within: float,
) -> tuple[list[tuple[float, Index]], float]:
    """Return where the modes of the larger cells lie on the last level, and the best's depth."""
    loose = LOOSER * min_overlap
    modes, depth = _best_of_all(levels[0], normalized, loose, kept[0], within)
    for above, below in pairwise(levels[:-1]):
        probe = LocalScores(below, normalized=normalized, min_overlap=loose)
        probe.score(near for _, mode in modes for near in probe.box(_below(above, below, mode)))
        probe.close()
        modes = _best_known(probe, kept[1], WITHIN[1] * depth)
    above = levels[max(len(levels) - 2, 0)]
    return [(value, _below(above, levels[-1], mode)) for value, mode in modes], depth


def _in_doubt(level: Level, depth: float, residual: float) -> bool:
    """
    Whether noise may hide the best on larger cells, and scoring all of them is affordable.

    With weights that are inverse variances up to a factor, the residual gives the factor, and
    cells / 2 * depth / residual is the logarithm of the likelihood ratio of the best place of
    larger cells and a usual one.

    """
    if math.prod(level.lattice.shape) > MOST_IN_DOUBT:
        return False
    return bool(0.5 * cv2.countNonZero(level.weight) * depth < DOUBT * residual)


def _climbs(
    level: Level, places: list[Index], normalized: bool, min_overlap: float
) -> dict[Index, float]:
    """Climb from each place on the level's own cells; return what was scored."""
    make = partial(LocalScores, level, normalized=normalized, min_overlap=min_overlap)
    probe = make() if level.window.size <= SMALL_WINDOW * math.prod(level.canvas.shape) else None
    known: dict[Index, float] = probe.known if probe else {}
    for place in places:
        done = place in known
        while not done:
            near = probe or make(about=place, reach=REACH)
            near.known = known
            place, done = _climb(near, place)
            if near is not probe:
                near.close()
    if probe:
        probe.close()
    return known


def _levels(level: Level) -> list[Level]:
    """Return the level and those of larger cells, the largest cells first."""
    levels = [level]
    while len(levels) <= MOST_DOWNSAMPLINGS and (factor := _factor(levels[0])) > 1:
        levels.insert(0, levels[0].downsampled(factor))
    return levels


def _factor(level: Level) -> int:
    """Return how many cells may be averaged per side: three where that leaves few translations."""
    cells = level.grid.rows * level.grid.cols
    translations = level.lattice.shape[1] * level.lattice.shape[2]
    if translations <= FEW or cells < 4 * LEAST_CELLS:
        return 1
    return 3 if cells >= 9 * LEAST_CELLS and translations <= 9 * FEW else 2


def _scorer(level: Level, normalized: bool, min_overlap: float) -> Scorer:
    return Scorer(
        level.values, level.weight, level.window, level.known,
        normalized=normalized, min_overlap=min_overlap, residual_only=True,
        everywhere=level.everywhere,
    )


def _winner(level: Level, index: Index, residual: float) -> Winner:
    return Winner(index, residual, level.lattice.pose(np.array(index, float)))


def _best_of_all(
    level: Level, normalized: bool, min_overlap: float, count: int, within: float
) -> tuple[list[Mode], float]:
    """Return the modes of the whole window, best first, and how deep the best lies."""
    scorer = _scorer(level, normalized, min_overlap)
    found: list[Mode] = []
    depths: list[float] = []
    for yaws, own in _blocks(level.lattice.shape):
        modes, depth = _best_of_block(level, scorer, yaws, count, within)
        found += [mode for mode in modes if own.start - 0.5 <= mode[1][0] < own.stop - 0.5]
        depths.append(depth)
    return sorted(found)[:count], max(depths)


def _blocks(shape: tuple[int, int, int]) -> list[tuple[slice, range]]:
    """Divide yaws so that memory is bounded: those to be scored, and those of a block alone."""
    count = shape[0]
    size = max(BLOCK_CANDIDATES // (shape[1] * shape[2]), LEAST_YAWS)
    return [
        (slice(max(first - 1, 0), min(first + size + 1, count)),
         range(first, min(first + size, count)))
        for first in range(0, count, size)
    ]


def _best_of_block(
    level: Level, scorer: Scorer, yaws: slice, count: int, within: float
) -> tuple[list[Mode], float]:
    """Return the modes of some yaws, best first, and how deep the best lies."""
    lattice = replace(level.lattice, yaws=level.lattice.yaws[yaws])
    residual = np.empty(lattice.shape, np.float32)

    def keep(part: slice, found: Residuals) -> None:
        residual[part] = found.residual

    score_yaws(scorer, level.grid, level.canvas, lattice, keep)
    flat = residual.ravel()
    crowd, middle = min(CROWD * count, flat.size), flat.size // 2
    order = np.argpartition(flat, crowd - 1)[:crowd]
    least, usual = float(flat[order].min()), float(np.partition(flat, middle)[middle])
    if not np.isfinite(least):
        return [], 0.0
    depth = usual - least if np.isfinite(usual) else np.inf
    order = order[flat[order] <= least + within * depth]
    order = order[np.lexsort((order, flat[order]))]
    places = np.stack(np.unravel_index(order, residual.shape), axis=1)
    modes = modes_of(places, ResidualLookup(residual), count)
    return [(value, (peak[0] + yaws.start, *peak[1:])) for value, peak in modes], depth


def _best_known(probe: LocalScores, count: int, above: float) -> list[Mode]:
    """Return the modes among what was scored, at most so far above the best of them."""
    values = probe.known
    order = sorted(values, key=lambda place: (values[place], place))[: CROWD * count]
    if not order or not np.isfinite(values[order[0]]):
        return []
    limit = values[order[0]] + above
    chosen = [place for place in order if values[place] <= limit]
    return modes_of(np.array(chosen), values, count)


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


def _climb(probe: LocalScores, place: Index) -> tuple[Index, bool]:
    """
    Go to the best neighbour until there is no better one; in a flat valley, look farther.

    The flag is False where the way leaves what the probe holds.

    """
    for _ in range(MAX_CLIMB):
        if not probe.holds(place):
            return place, False
        before = place
        place = probe.best_about(before)
        if place == before and probe.is_shallow(place, SHALLOW):
            place = probe.best_about(before, reach=2)
        if place == before:
            break
    return place, True
