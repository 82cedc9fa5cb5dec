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
    around_winner,
    coarse_factor,
    lattice_scores,
    search_window,
    SearchResult,
)
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.parameters import Parameters

MAX_CELLS = 400_000  # coarse map cells; a larger map is searched on larger cells
CANDIDATES = 12  # places of the largest cells that are compared on smaller ones; chosen
MOST_SEARCHED = 6  # of them that are searched to the end, those that look most alike
KEPT = (64, 32)  # modes of the largest cells and below: 11 of 14 frames among cars, 9 with half
WITHIN = 0.6  # over the best of them, as a share of its depth
LOCAL_COVARIANCE = np.eye(3)  # m^2, rad^2: local searches hardly use the coarse pose as a prior


def global_search(
    view: View, weight: Floats, crops: MapCrops, stamp_ns: int, parameters: Parameters,
    *, refiner: Refiner, errors: FrameErrors,
) -> SearchResult | None:
    """
    Find the view anywhere on the map, at any heading.

    Only places that look nearly as good on the lattice as the best are searched to the end.

    Returns
    -------
    SearchResult or None
        The best local search, with the winner's mass taken over all of them; None where the map
        and the view share nothing.

    """
    places = coarse_places(view, weight, crops, parameters)
    if not places:
        return None
    normalized = parameters.score.normalized
    side = 1.5 * places[0].step
    extent = SearchWindow(
        side, side, 1.2 * parameters.recovery.yaw_step, parameters.search.yaw_step,
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
        searched(place.pose) for alike, place in ranked[:MOST_SEARCHED]
        if alike >= COMPETITOR_SHARE * ranked[0][0]
    ]
    found = _one_each([f for f in searches if f is not None])
    if not found:
        return None
    return _with_competitors(looked_around(found, searched), independent_cells(weight))


def looked_around(
    found: list[SearchResult], search: Callable[[Pose2], SearchResult | None]
) -> list[SearchResult]:
    """
    Look around the first place where its fit lies beyond what was compared with it.

    Returns
    -------
    list of SearchResult
        Best first: the look may find less than another place has.

    """
    first = around_winner(found[0], search) or found[0]
    return sorted([first, *found[1:]], key=_fit_score, reverse=True)


def _fit_score(found: SearchResult) -> float:
    return found.fits[0].fit_score


def _one_each(searches: list[SearchResult]) -> list[SearchResult]:
    """Of searches that end at one place, leave the one that looked around it; best first."""
    kept: list[SearchResult] = []
    for found in sorted(searches, key=lambda search: search.beyond):
        if all(found.fits[0].distance(other.fits[0]) > SAME_PLACE for other in kept):
            kept.append(found)
    return sorted(kept, key=_fit_score, reverse=True)


def _likeness(scores: Scores) -> float:
    """Best correlation of a window; 0 where nothing overlaps the map enough."""
    return float(scores.correlation[np.isfinite(scores.residual)].max(initial=0.0))


@dataclass(frozen=True)
class Place:
    """A coarse candidate: its residual, its pose, and the side of the cells it is from, m."""

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
    return _apart([Place(residual, pose, step) for residual, pose in found])


def _apart(places: list[Place]) -> list[Place]:
    """Leave out places next to better ones."""
    kept: list[Place] = []
    for place in places:
        gaps = (difference(place.pose, other.pose) for other in kept)
        if all(np.hypot(gap[0], gap[1]) > 2.5 * place.step or abs(gap[2]) > 0.1 for gap in gaps):
            kept.append(place)
    return kept


def _with_competitors(found: list[SearchResult], cells: float) -> SearchResult:
    """Return the best local search with the other places; their mass is taken from its winner."""
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
    return replace(best.beside(competitors), surface=surface)
