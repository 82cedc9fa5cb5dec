# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Search of the whole map, coarse to fine, for `~/relocalize` and after a loss."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import View
from gip_localizer.core.footprints import Grid
from gip_localizer.core.levels import coarsened
from gip_localizer.core.matching import make_lattice, match, Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.core.posterior import independent_cells, modes, posterior_surface
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.core.refinement import Refiner
from gip_localizer.core.search import coarse_factor, Extent, Found, search_window
from gip_localizer.core.tracker import Belief
from gip_localizer.parameters import Parameters

MAX_CELLS = 400_000  # coarse map cells; a larger map is searched on larger cells
CANDIDATES = 12
LOCAL_SIGMA = 1.0  # m: the local searches hardly use the coarse pose as a prior


def global_search(
    view: View, weight: Floats, raster_map: RasterMap, stamp_ns: int, parameters: Parameters,
    *, refiner: Refiner,
) -> Found | None:
    """
    Find the view anywhere on the map, at any heading.

    Returns
    -------
    Found or None
        The best local search, with the winner's mass taken over all of them; None where the map
        and the view share nothing.

    """
    normalized = parameters.score.metric.endswith('normalized')
    coarse = coarse_scores(view, weight, raster_map, parameters)
    if coarse is None or not np.isfinite(coarse.residual).any():
        return None
    surface = posterior_surface(coarse, independent_cells(weight), None)
    step, yaw_step = coarse.lattice.step, parameters.recovery.yaw_step
    extent = Extent(1.5 * step, 1.5 * step, 1.2 * yaw_step, parameters.search.yaw_step,
                    parameters.score.min_overlap)
    covariance = np.diag([LOCAL_SIGMA**2, LOCAL_SIGMA**2, 1.0])
    locals_ = [
        search_window(
            view, weight, raster_map,
            Belief(stamp_ns, coarse.lattice.pose(np.array(index, float)), covariance), extent,
            refiner=refiner, normalized=normalized,
        )
        for index in modes(surface, CANDIDATES)
    ]
    found = [f for f in locals_ if f is not None and f.fits and f.surface is not None]
    if not found:
        return None
    found.sort(key=lambda f: -f.fits[0].correlation)
    return _with_rivals(found, independent_cells(weight))


def coarse_scores(
    view: View, weight: Floats, raster_map: RasterMap, parameters: Parameters
) -> Scores | None:
    """Score every pose on the map on large cells; None where the map has no part to search."""
    recovery = parameters.recovery
    width, height = raster_map.size_m
    cell = max(recovery.cell, math.sqrt(width * height / MAX_CELLS))
    factor = coarse_factor(view.grid.resolution, cell)
    joined, joined_weight = coarsened(view, weight, factor)
    step = joined.grid.resolution
    reach = _reach(joined.grid)
    centre = raster_map.origin @ Pose2(0.5 * width, 0.5 * height, 0.0)
    count = max(round(2.0 * math.pi / recovery.yaw_step), 1)
    half_turn = math.pi * (1.0 - 1.0 / count)
    lattice = make_lattice(
        centre, x=0.5 * width + reach, y=0.5 * height + reach, yaw=half_turn,
        yaw_step=2.0 * math.pi / count, step=step,
    )
    corners = np.array([[0.0, 0.0], [width, 0.0], [width, height], [0.0, height]])
    crop = raster_map.crop(raster_map.origin.transform(corners), margin=0.0, cell=step)
    if crop is None:
        return None
    return match(
        joined, joined_weight, crop, lattice,
        normalized=parameters.score.metric.endswith('normalized'),
        min_overlap=parameters.score.min_overlap,
    )


def _reach(grid: Grid) -> float:
    """Farthest distance of a view's centre from base, metres: how far off the map base may be."""
    return float(math.hypot(grid.far - 0.5 * grid.rows * grid.resolution, 0.0))


def _with_rivals(found: list[Found], cells: float) -> Found:
    """Return the best local search, its winner's mass weighed against the other places."""
    best = found[0]
    winner = best.fits[0]
    rest = max(1.0 - winner.correlation**2, 1e-6)
    rivals = [
        f.fits[0] for f in found[1:]
        if math.hypot(f.fits[0].pose.x - winner.pose.x, f.fits[0].pose.y - winner.pose.y) > 0.2
    ]
    evidence = [
        math.exp(max(-0.5 * cells * ((1.0 - max(f.correlation, 0.0) ** 2) / rest - 1.0), -700.0))
        for f in rivals
    ]
    mass = 1.0 / (1.0 + sum(evidence))
    assert best.surface is not None
    surface = replace(best.surface, winner_mass=best.surface.winner_mass * mass)
    return replace(best, surface=surface)
