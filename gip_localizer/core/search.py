# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Steps 3 and 4 about one place: score a window of candidates, refine the best modes, keep one.

The lattice is scored on joined cells (`COARSE_CELL`), whose sums lose nothing but detail; the
continuous refinement on the full view then gives the pose.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import View
from gip_localizer.core.camera_sway import pitched
from gip_localizer.core.fit import Fit
from gip_localizer.core.levels import coarsened
from gip_localizer.core.matching import make_lattice, match, Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.core.posterior import (
    independent_cells,
    modes,
    posterior_surface,
    subcell_peak,
    Surface,
)
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.core.refinement import Refiner
from gip_localizer.core.tracker import Belief

COARSE_CELL = 0.1  # m: cells are joined up to this side for the lattice
REFINED_MODES = 3
PLAIN_WINNER = 0.9  # merit of a fit beside which no other mode needs a look
HOPELESS = -40.0  # log posterior below the winner's at which a mode is not refined


@dataclass(frozen=True)
class Extent:
    """Half-widths of a window (m, m, rad), its step in heading (rad) and least overlap."""

    x: float
    y: float
    yaw: float
    yaw_step: float
    min_overlap: float


@dataclass(frozen=True, eq=False)
class Found:
    """
    What a search found.

    Attributes
    ----------
    scores : Scores
        The surface on the lattice.
    surface : Surface or None
        Its posterior; None where no candidate overlaps the map enough.
    fits : list of Fit
        Refined modes, best first.

    """

    scores: Scores
    surface: Surface | None
    fits: list[Fit]


def coarse_factor(resolution: float, cell: float = COARSE_CELL) -> int:
    """Return how many cells are joined per side for a lattice of about `cell` metres."""
    return max(int(cell / resolution + 1e-6), 1)


def crop_about(raster_map: RasterMap, view: View, pose: Pose2, extent: Extent,
               cell: float) -> RasterMap | None:
    """Return the part of the map that any candidate of a window may touch."""
    grid = view.grid
    xs = np.array([grid.far, grid.far - grid.rows * grid.resolution])
    ys = np.array([grid.left, grid.left - grid.cols * grid.resolution])
    corners = np.stack(np.meshgrid(xs, ys), axis=-1).reshape(-1, 2)
    turns = np.linspace(-extent.yaw, extent.yaw, 2 + int(extent.yaw / 0.1))
    turned = np.concatenate([
        (pose @ Pose2(0.0, 0.0, float(turn))).transform(corners) for turn in turns
    ])
    margin = float(np.hypot(extent.x, extent.y)) + 0.5
    return raster_map.crop(turned, margin=margin, cell=cell)


def search_window(
    view: View, weight: Floats, raster_map: RasterMap, prior: Belief, extent: Extent, *,
    refiner: Refiner, normalized: bool,
) -> Found | None:
    """
    Find the best poses in a window about a prior.

    Parameters
    ----------
    view, weight : View, (rows, cols) float32
        Bird's-eye view and the Gramian's diagonal.
    raster_map : RasterMap
        The whole map.
    prior : Belief
        Centre of the window, and a prior on the candidates.
    extent : Extent
        Size of the window.
    refiner : Refiner
        For the view's calibration.
    normalized : bool
        Whether gain and offset are profiled out.

    Returns
    -------
    Found or None
        None where the window lies off the map.

    """
    fine = crop_about(raster_map, view, prior.pose, extent, view.grid.resolution)
    if fine is None:
        return None
    tries = [
        _try_pitch(view, weight, raster_map, prior, extent, refiner, normalized, pitch)
        for pitch in refiner.pitches
    ]
    surfaces = [(pitch, scores, surface) for pitch, scores, surface in tries if surface]
    if not surfaces:
        return Found(tries[0][1], None, [])
    starts = [
        (scores.residual[index], scores, surface, index, pitch)
        for pitch, scores, surface in surfaces
        for index in modes(surface, REFINED_MODES)
        if surface.log_posterior[index] > HOPELESS
    ]
    starts.sort(key=lambda start: float(start[0]))
    fits: list[Fit] = []
    for _, scores, surface, index, pitch in starts[:REFINED_MODES]:
        start = scores.lattice.pose(subcell_peak(surface, index))
        fits.append(refiner.refine(view, weight, fine, start, pitch=pitch))
        if fits[-1].merit > PLAIN_WINNER:
            break
    return Found(starts[0][1], starts[0][2], sorted(fits, key=lambda fit: -fit.merit))


def _try_pitch(
    view: View, weight: Floats, raster_map: RasterMap, prior: Belief, extent: Extent,
    refiner: Refiner, normalized: bool, pitch: float,
) -> tuple[float, Scores, Surface | None]:
    """Score the window as if the camera were pitched; no surface where nothing overlaps."""
    moved, moved_weight = pitched(refiner.camera, view, weight, pitch)
    scores = lattice_scores(
        moved, moved_weight, raster_map, prior.pose, extent, normalized=normalized
    )
    if not np.isfinite(scores.residual).any():
        return pitch, scores, None
    return pitch, scores, posterior_surface(scores, independent_cells(weight), prior)


def lattice_scores(
    view: View, weight: Floats, raster_map: RasterMap, anchor: Pose2, extent: Extent, *,
    normalized: bool, cell: float = COARSE_CELL,
) -> Scores:
    """Score the window on cells joined up to `cell` metres."""
    factor = coarse_factor(view.grid.resolution, cell)
    joined, joined_weight = coarsened(view, weight, factor)
    step = joined.grid.resolution
    crop = crop_about(raster_map, view, anchor, extent, step)
    lattice = make_lattice(anchor, x=extent.x, y=extent.y, yaw=extent.yaw,
                           yaw_step=extent.yaw_step, step=step)
    return match(joined, joined_weight, crop or raster_map, lattice, normalized=normalized,
                 min_overlap=extent.min_overlap, centred=normalized)
