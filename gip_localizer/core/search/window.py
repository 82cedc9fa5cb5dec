# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How wide a search is: what the belief leaves open, and no less than its errors."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.belief import Belief
from gip_localizer.parameters import Parameters

FIRST_FIX_SIGMAS = 2.0  # standard deviations of a first prior that its window covers; chosen
FIRST_FIX_LIMITS = (5.0, 0.6)  # largest half-widths of that window, m and rad; chosen for its time
MOST_REACH = 10.0  # m: half-width of the widest search for places that equal a match
# Cell of the lattice while tracking, m; coarse, for it only excludes other places.
FOLLOWED_CELL = 0.2
FOLLOWED_SIGMAS = 4.0  # standard deviations of a confirmed belief that its window covers; chosen
FOLLOWED_MARGIN = (0.2, 0.0150)  # added to them, m and rad; chosen


@dataclass(frozen=True)
class SearchWindow:
    """
    A window of candidates.

    Attributes
    ----------
    x, y, yaw : float
        Half-widths, m, m, rad.
    yaw_step : float
        Step in heading, rad.
    min_overlap : float
        Least share of the weight on known map cells.
    modes : int
        Most peaks of the score surface that are refined while none is plainly the winner.
    cell : float
        Cells are averaged up to this side, m, for the score surface.
    near : bool
        The surface's peak is near enough to be refined from the second stage on.

    """

    x: float
    y: float
    yaw: float
    yaw_step: float
    min_overlap: float
    modes: int = 3
    cell: float = 0.1
    near: bool = False


def configured_window(_: Belief, parameters: Parameters) -> SearchWindow:
    """Return the window that the parameters give."""
    search = parameters.search
    return SearchWindow(
        search.x, search.y, search.yaw, search.yaw_step, parameters.score.min_overlap
    )


def first_fix_window(prior: Belief, parameters: Parameters) -> SearchWindow:
    """Return the window about a prior from outside: wider where that says so."""
    search, (sigma, sigma_yaw) = parameters.search, _sigmas(prior)
    wide = min(FIRST_FIX_SIGMAS * sigma, FIRST_FIX_LIMITS[0])
    wide_yaw = min(FIRST_FIX_SIGMAS * sigma_yaw, FIRST_FIX_LIMITS[1])
    return SearchWindow(
        max(search.x, wide), max(search.y, wide), max(search.yaw, wide_yaw), search.yaw_step,
        parameters.score.min_overlap,
    )


def equal_places_window(reach: float, parameters: Parameters) -> SearchWindow:
    """Return the window in which places that equal a match may lie: `reach` m on each side."""
    search = parameters.search
    return SearchWindow(
        reach, reach, search.yaw, search.yaw_step, parameters.score.min_overlap, modes=1,
        cell=FOLLOWED_CELL,
    )


def tracking_window(prior: Belief, parameters: Parameters) -> SearchWindow:
    """Return the window about a belief that published fixes confirm: only what it leaves open."""
    search, (sigma, sigma_yaw) = parameters.search, _sigmas(prior)
    near = FOLLOWED_SIGMAS * sigma + FOLLOWED_MARGIN[0]
    near_yaw = FOLLOWED_SIGMAS * sigma_yaw + FOLLOWED_MARGIN[1]
    return SearchWindow(
        min(search.x, near), min(search.y, near), min(search.yaw, near_yaw), search.yaw_step,
        parameters.score.min_overlap, modes=1, cell=FOLLOWED_CELL, near=True,
    )


def _sigmas(prior: Belief) -> tuple[float, float]:
    """Largest standard deviation of x and y, and that of yaw."""
    variance = prior.own_covariance
    return math.sqrt(max(variance[0, 0], variance[1, 1])), math.sqrt(variance[2, 2])
