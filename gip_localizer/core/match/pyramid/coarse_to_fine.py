# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The best candidate of a lattice: by scoring all of them, or coarse to fine.

The coarse-to-fine search scores the whole window on larger cells, keeps the best modes, and
follows them down to the cells of the lattice, where the exact residual decides. The result is a
local minimum of the exact score. Whether it is the global minimum is measured (`gip bench`) and
not proven, because averages over larger cells lose the noise inside them. If the best mode of the
larger cells does not exceed the noise clearly, all candidates are scored.

The localizer uses it to search the whole map; around a prior it needs all scores for its
posterior, and computes them on larger cells (`search`).

"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
import math

import cv2
import numpy as np

from gip_localizer.core.match.lattice import Index
from gip_localizer.core.match.peaks import Mode, modes_of, Peak
from gip_localizer.core.match.pyramid.climb import climb_all
from gip_localizer.core.match.pyramid.level import Level, pyramid_levels
from gip_localizer.core.match.pyramid.local_scores import LocalScores
from gip_localizer.core.match.pyramid.whole_window import (
    best_of_window,
    CANDIDATES_PER_MODE,
    make_scorer,
)
from gip_localizer.core.match.score_surface import score_yaws
from gip_localizer.core.match.scoring import Residuals
from gip_localizer.core.pose import Pose2

# Number of modes that are kept of the whole window, and of each level below (design choice: 32 and
# 16; `gip bench` compares the result with that of all candidates).
KEPT = (32, 16)
# Largest residual above the best one, as shares of its depth in the window (no unit), of modes of
# the whole window, of the levels below, and of starts on the finest cells (design choice: 0.35,
# 0.15 and 0.2, because the order of modes changes less on smaller cells).
WITHIN = (0.35, 0.15, 0.2)
# Number of starts on the finest cells (design choice: 4, because their residuals are exact and few
# modes are near ties).
CLIMBED = 4
# Factor on the least overlap for larger cells (no unit; design choice: 0.8, because cells at the
# edge of the known map may count as known or unknown).
OVERLAP_SLACK = 0.8
# Log likelihood ratio (no unit) below which all candidates are scored (measured: below it larger
# cells have hidden the best candidate).
DOUBT = 500.0
# Largest number of candidates that are all scored in doubt (design choice: 5,000,000, because more
# take too long).
MAX_EXHAUSTIVE = 5_000_000
# Number of candidates that a climb scores around its end: 3 x 3 x 3 neighbours.
CLIMB_NEIGHBOURS = 27


@dataclass(frozen=True)
class Winner:
    """
    The best candidate.

    Attributes
    ----------
    index : (int, int, int)
        Indices of yaw, x and y in the lattice.
    residual : float
        Its weighted mean square residual; inf if no candidate overlaps the map enough.
    pose : Pose2
        Pose of base in map.

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

    scorer = make_scorer(level, normalized, min_overlap)
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
    levels = pyramid_levels(level)
    if len(levels) == 1:
        return exhaustive_winner(level, normalized=normalized, min_overlap=min_overlap)
    count = kept[0] if len(levels) > 2 else min(2 * CLIMBED, kept[0])
    modes, depth = _descend(levels, normalized, min_overlap, (count, kept[1]), WITHIN[0])
    places = [place for value, place in modes[:CLIMBED]
              if value <= modes[0][0] + WITHIN[2] * depth]
    known = climb_all(level, places, normalized, min_overlap)
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
    Search coarse to fine for the places of local minima.

    Parameters
    ----------
    level, normalized, min_overlap, kept
        As for `pyramid_winner`.
    count : int
        Largest number of places that are returned.
    within : float
        Largest residual of a mode of the largest cells above the best, as a share of its depth.

    Returns
    -------
    list of (float, Pose2)
        Exact residual, and pose between the candidates; best first, none twice.

    """
    levels = pyramid_levels(level)
    modes, _ = _descend(levels, normalized, min_overlap, kept, within)
    known = climb_all(level, [place for _, place in modes], normalized, min_overlap)
    order = sorted(known, key=lambda place: (known[place], place))
    finite = np.array([place for place in order if np.isfinite(known[place])])
    if not len(finite):
        return []
    finite = finite[: CLIMB_NEIGHBOURS * count]
    return [(value, level.lattice.pose(np.array(peak)))
            for value, peak in modes_of(finite, known, count)]


def _descend(
    levels: list[Level], normalized: bool, min_overlap: float, kept: tuple[int, int],
    within: float,
) -> tuple[list[tuple[float, Index]], float]:
    """Return modes of the larger cells on the last level, and the depth of the best one."""
    loose = OVERLAP_SLACK * min_overlap
    modes, depth = best_of_window(levels[0], normalized, loose, kept[0], within)
    for above, below in pairwise(levels[:-1]):
        scores = LocalScores(below, normalized=normalized, min_overlap=loose)
        scores.score(near for _, mode in modes for near in scores.box(_below(above, below, mode)))
        scores.close()
        modes = _best_known(scores, kept[1], WITHIN[1] * depth)
    above = levels[max(len(levels) - 2, 0)]
    return [(value, _below(above, levels[-1], mode)) for value, mode in modes], depth


def _in_doubt(level: Level, depth: float, residual: float) -> bool:
    """
    Return whether noise may hide the best on larger cells, and all can be scored in time.

    With weights that are inverse variances up to a factor, the residual gives the factor, and
    cells / 2 * depth / residual is the logarithm of the likelihood ratio of the best place of
    larger cells and a usual one.

    """
    if math.prod(level.lattice.shape) > MAX_EXHAUSTIVE:
        return False
    return bool(0.5 * cv2.countNonZero(level.weight) * depth < DOUBT * residual)


def _winner(level: Level, index: Index, residual: float) -> Winner:
    return Winner(index, residual, level.lattice.pose(np.array(index, float)))


def _best_known(scores: LocalScores, count: int, above: float) -> list[Mode]:
    """Return the modes among the scored candidates, at most `above` over the best of them."""
    values = scores.known
    order = sorted(values, key=lambda place: (values[place], place))[: CANDIDATES_PER_MODE * count]
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
