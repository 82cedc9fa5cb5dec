# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Size of the search window, from the covariance of the belief and the parameters."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.belief import Belief
from gip_localizer.parameters import Parameters

# Number of standard deviations of an initial pose that its window contains (design choice: 2,
# because a wider window takes more time, and 86 % of the positions are inside).
FIRST_FIX_SIGMAS = 2.0
# Largest half-widths of this window (m, rad; design choice: 5 m and 0.6 rad, because a larger
# window takes longer than a frame).
FIRST_FIX_LIMITS = (5.0, 0.6)
# Largest half-width (m) of the search for places that equal a match (design choice: 10 m, because
# it contains the next dashes of a road, and its time grows with the square).
MAX_REACH = 10.0
# Cell (m) of the lattice while tracking (design choice: 0.2 m, because the lattice then only
# excludes other places).
TRACKING_CELL = 0.2
# Number of standard deviations of a confirmed belief that its window contains (design choice: 4,
# because a normal error lies outside once in 16,000 frames).
TRACKING_SIGMAS = 4.0
# Half-widths (m, rad) that are added to them (design choice: a cell of the lattice, and its error
# at a distance of 13 m).
TRACKING_MARGIN = (0.2, 0.0150)


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
        Largest number of peaks that are refined while none is a clear winner.
    cell : float
        Largest side (m) to which cells are averaged for the score surface.
    near : bool
        The peak is near enough to the optimum for a refinement without the first stage.

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
    """Return the window of the parameters."""
    search = parameters.search
    return SearchWindow(
        search.x, search.y, search.yaw, search.yaw_step, parameters.score.min_overlap
    )


def first_fix_window(prior: Belief, parameters: Parameters) -> SearchWindow:
    """Return the window around an initial pose, which its covariance may widen."""
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
        cell=TRACKING_CELL,
    )


def tracking_window(prior: Belief, parameters: Parameters) -> SearchWindow:
    """Return the window around a belief that published fixes confirm, from its covariance."""
    search, (sigma, sigma_yaw) = parameters.search, _sigmas(prior)
    near = TRACKING_SIGMAS * sigma + TRACKING_MARGIN[0]
    near_yaw = TRACKING_SIGMAS * sigma_yaw + TRACKING_MARGIN[1]
    return SearchWindow(
        min(search.x, near), min(search.y, near), min(search.yaw, near_yaw), search.yaw_step,
        parameters.score.min_overlap, modes=1, cell=TRACKING_CELL, near=True,
    )


def _sigmas(prior: Belief) -> tuple[float, float]:
    """Largest standard deviation of x and y, and that of yaw."""
    variance = prior.own_covariance
    return math.sqrt(max(variance[0, 0], variance[1, 1])), math.sqrt(variance[2, 2])
