# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Search of the whole map, coarse to fine, for `~/relocalize` and after a loss."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.match.posterior import independent_cells
from gip_localizer.core.match.pyramid.coarse_to_fine import pyramid_modes
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.fit import SAME_PLACE
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.hypotheses import COMPETITOR_SHARE
from gip_localizer.core.search.local_search import (
    coarse_factor,
    lattice_scores,
    search_window,
)
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.search_result import around_winner, SearchResult
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.parameters import Parameters

# Largest number of coarse cells of a map (design choice: 400,000, because the search of more takes
# many seconds); a larger map is searched on larger cells.
MAX_CELLS = 400_000
# Number of places of the largest cells that are compared on smaller ones (design choice:
# twice `MOST_SEARCHED`).
CANDIDATES = 12
# Largest number of these places that are searched to the end, the most similar first (measured: it
# bounds the time of a search in which no place fits, and changes nothing else, docs/accuracy.md).
MAX_SEARCHED = 6
# Number of modes that are kept of the largest cells, and of each level below (measured: 11 of 14
# frames among cars are found, 9 with half as many).
KEPT = (64, 32)
# Largest residual of a kept mode above the best one, as a share of the depth of the best (no unit;
# design choice: 0.6, because among cars the true place is far from the best on large cells).
WITHIN = 0.6
# Covariance (m², rad²) of the prior of a local search (design choice: 1, because a coarse pose
# must hardly constrain it).
LOCAL_COVARIANCE = np.eye(3)
# Half-width of a local search, in cells and in steps of heading of the coarse search (design
# choice: 1.5 and 1.2, because the true place may lie one cell or step away).
LOCAL_CELLS, LOCAL_YAWS = 1.5, 1.2
# Distance (cells) and angle (rad) below which two coarse places are one (design choice: 2.5 and
# 0.1, because one mode has several maxima on large cells).
SAME_CELLS, SAME_YAW = 2.5, 0.1


def global_search(
    view: View, weight: Floats, crops: MapCrops, stamp_ns: int, parameters: Parameters,
    *, refiner: Refiner, errors: FrameErrors,
) -> SearchResult | None:
    """
    Find the view anywhere on the map, at any heading.

    Only places whose correlation on the lattice is nearly the best are searched to the end.

    Returns
    -------
    SearchResult or None
        Result of the best local search, with the posterior mass of its winner among all of them;
        None if view and map do not overlap.

    """
    places = coarse_places(view, weight, crops, parameters)
    if not places:
        return None
    normalized = parameters.score.normalized
    side = LOCAL_CELLS * places[0].step
    extent = SearchWindow(
        side, side, LOCAL_YAWS * parameters.recovery.yaw_step, parameters.search.yaw_step,
        parameters.score.min_overlap,
    )

    def searched(pose: Pose2) -> SearchResult | None:
        found = search_window(
            view, weight, crops, Belief(stamp_ns, pose, LOCAL_COVARIANCE), extent,
            refiner=refiner, normalized=normalized, errors=errors,
        )
        return found if found is not None and found.fits else None

    likeness = [
        _likeness(lattice_scores(view, weight, crops, place.pose, extent, normalized=normalized))
        for place in places
    ]
    ranked = sorted(zip(likeness, places, strict=True), key=lambda pair: -pair[0])
    searches = [
        searched(place.pose) for alike, place in ranked[:MAX_SEARCHED]
        if alike >= COMPETITOR_SHARE * ranked[0][0]
    ]
    found = _one_per_place([f for f in searches if f is not None])
    if not found:
        return None
    return _with_competitors(with_surroundings(found, searched), independent_cells(weight))


def with_surroundings(
    found: list[SearchResult], search: Callable[[Pose2], SearchResult | None]
) -> list[SearchResult]:
    """
    Search again around the first place if its fit lies outside its window.

    Returns
    -------
    list of SearchResult
        Best first: the second search may end at a worse place than another search.

    """
    first = around_winner(found[0], search) or found[0]
    return sorted([first, *found[1:]], key=_fit_score, reverse=True)


def _fit_score(found: SearchResult) -> float:
    return found.fits[0].fit_score


def _one_per_place(searches: list[SearchResult]) -> list[SearchResult]:
    """Keep one of the searches that end at the same place, the most central; best first."""
    kept: list[SearchResult] = []
    for found in sorted(searches, key=lambda search: search.distance_outside):
        if all(found.fits[0].distance(other.fits[0]) > SAME_PLACE for other in kept):
            kept.append(found)
    return sorted(kept, key=_fit_score, reverse=True)


def _likeness(scores: Scores) -> float:
    """Return the best correlation of a window; 0 if nothing overlaps the map enough."""
    return float(scores.correlation[np.isfinite(scores.residual)].max(initial=0.0))


@dataclass(frozen=True)
class Place:
    """A coarse candidate: its residual, its pose, and the side of its cells, m."""

    residual: float
    pose: Pose2
    step: float


def coarse_places(
    view: View, weight: Floats, crops: MapCrops, parameters: Parameters
) -> list[Place]:
    """Return the best places of the whole map on large cells, best first."""
    recovery, normalized = parameters.recovery, parameters.score.normalized
    width, height = crops.raster_map.size_m
    cell = max(recovery.cell, math.sqrt(width * height / MAX_CELLS))
    step = view.grid.resolution * coarse_factor(view.grid.resolution, cell)
    whole = crops.whole(step, patterned=normalized)
    level = whole.level(view, weight, recovery.yaw_step)
    found = pyramid_modes(
        level, normalized=normalized, min_overlap=parameters.score.min_overlap, count=CANDIDATES,
        kept=KEPT, within=WITHIN,
    )
    return _distinct([Place(residual, pose, step) for residual, pose in found])


def _distinct(places: list[Place]) -> list[Place]:
    """Return the places without those next to better ones."""
    kept: list[Place] = []
    for place in places:
        gaps = (difference(place.pose, other.pose) for other in kept)
        if all(
            np.hypot(gap[0], gap[1]) > SAME_CELLS * place.step or abs(gap[2]) > SAME_YAW
            for gap in gaps
        ):
            kept.append(place)
    return kept


def _with_competitors(found: list[SearchResult], cells: float) -> SearchResult:
    """Return the best result with the other places, which reduce the mass of its winner."""
    best = found[0]
    winner = best.fits[0]
    competitors = [f.fits[0] for f in found[1:] if f.fits[0].distance(winner) > SAME_PLACE]
    evidence = [
        math.exp(max(-0.5 * cells * math.expm1(2.0 * (winner.fit_score - f.fit_score)), -700.0))
        for f in competitors
    ]
    mass = 1.0 / (1.0 + sum(evidence))
    assert best.surface is not None
    surface = replace(best.surface, winner_mass=best.surface.winner_mass * mass)
    return replace(best.with_fits(competitors), surface=surface)
