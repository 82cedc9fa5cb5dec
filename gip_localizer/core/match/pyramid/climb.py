# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Climbs from places to the local minima of the exact residual, on the cells of one level."""

from __future__ import annotations

from functools import partial
import math

from gip_localizer.core.match.lattice import Index
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.match.pyramid.local_scores import LocalScores

# Share of the least residual (no unit) within which a neighbour is level with it, so that the
# climb looks farther (design choice: 0.004, because narrow valleys between lattice points are
# flat).
SHALLOW = 0.004
# Largest number of rounds of a climb (design choice: 20, because starts are few cells away).
MAX_CLIMB = 20
# Size of a window, in sizes of the canvas (no unit), up to which it is prepared once for all
# climbs (design choice: 1.5, because a larger window takes longer than a part for each climb).
SMALL_WINDOW = 1.5
# Number of translations around a start that are prepared for its climb (design choice: 4, because
# most climbs end within them).
REACH = 4


def climb_all(
    level: Level, places: list[Index], normalized: bool, min_overlap: float
) -> dict[Index, float]:
    """Climb from each place on the cells of the level; return all scored candidates."""
    make = partial(LocalScores, level, normalized=normalized, min_overlap=min_overlap)
    scores = make() if level.window.size <= SMALL_WINDOW * math.prod(level.canvas.shape) else None
    known: dict[Index, float] = scores.known if scores else {}
    for place in places:
        done = place in known
        while not done:
            near = scores or make(about=place, reach=REACH)
            near.known = known
            place, done = _climb(near, place)
            if near is not scores:
                near.close()
    if scores:
        scores.close()
    return known


def _climb(scores: LocalScores, place: Index) -> tuple[Index, bool]:
    """
    Go to the best neighbour until none is better; in a flat valley, also to farther ones.

    The flag is False if the path leaves the prepared candidates.

    """
    for _ in range(MAX_CLIMB):
        if not scores.holds(place):
            return place, False
        before = place
        place = scores.best_about(before)
        if place == before and scores.is_shallow(place, SHALLOW):
            place = scores.best_about(before, reach=2)
        if place == before:
            break
    return place, True
