# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Steps 3 and 4 about one place: score a window of candidates, refine the best modes, keep one.

The lattice is scored on joined cells (`COARSE_CELL`), whose sums lose nothing but detail; the
continuous refinement on the full view then gives the pose.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

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
from gip_localizer.core.windows import Extent

COARSE_CELL = 0.1  # m: cells are joined up to this side for the lattice
PEAKS = 3  # of each score surface that are looked at
MOST_RIVALS = 2
RIVAL_SHARE = 0.6  # of the best correlation on the lattice, from which a place is a rival
RIVAL_DISTANCE = 0.3  # m from the winner
PLAIN_WINNER = 1.0  # merit of a fit beside which no other mode needs a look, ...
PLAIN_DISPERSION = 3.0  # ... unless the parts of the view contradict each other more than this
ASIDE = (-0.2, 0.2)  # m ahead: starts beside a fit that is good but contradicts itself
HOPELESS = -40.0  # log posterior below the winner's at which a mode is not refined


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
    starts = sorted(
        (
            _Start(scores, surface, index, pitch)
            for pitch, scores, surface in surfaces for index in modes(surface, PEAKS)
        ),
        key=lambda start: start.residual,
    )

    layers = refiner.layers(view, weight, fine)

    def refined(start: _Start) -> Fit:
        return refiner.refine(layers, start.pose, pitch=start.pitch)

    fits: list[Fit] = []
    for start in [s for s in starts if s.log_posterior > HOPELESS][: extent.modes]:
        fits.append(refined(start))
        if fits[-1].merit > PLAIN_WINNER and fits[-1].overdispersion < PLAIN_DISPERSION:
            break
    best = max(fits, key=lambda fit: fit.merit)
    if best.merit > PLAIN_WINNER and best.overdispersion > PLAIN_DISPERSION:
        beside = (best.pose @ Pose2(ahead, 0.0, 0.0) for ahead in ASIDE)
        fits += [refiner.refine(layers, pose) for pose in beside]
        best = max(fits, key=lambda fit: fit.merit)
    fits += [refined(start) for start in _rivals(starts, best.pose)]
    return Found(
        starts[0].scores, starts[0].surface, sorted(fits, key=lambda fit: -fit.merit)
    )


@dataclass(frozen=True, eq=False)
class _Start:
    """A mode of the lattice's posterior."""

    scores: Scores
    surface: Surface
    index: tuple[int, int, int]
    pitch: float

    @property
    def residual(self) -> float:
        return float(self.scores.residual[self.index])

    @property
    def log_posterior(self) -> float:
        return float(self.surface.log_posterior[self.index])

    @property
    def correlation(self) -> float:
        return float(self.scores.correlation[self.index])

    @property
    def pose(self) -> Pose2:
        return self.scores.lattice.pose(subcell_peak(self.surface, self.index))


def _rivals(starts: list[_Start], winner: Pose2) -> list[_Start]:
    """
    Places that look nearly as good on the lattice as the winner: at most two.

    The posterior cannot tell: it knows nothing of what the lattice's coarse cells cost a place
    that lies between them.

    """
    least = RIVAL_SHARE * max(start.correlation for start in starts)
    rivals: list[_Start] = []
    for start in starts:
        others = [winner, *(rival.pose for rival in rivals)]
        apart = [math.hypot(start.pose.x - p.x, start.pose.y - p.y) for p in others]
        if start.correlation > least and min(apart) > RIVAL_DISTANCE:
            rivals.append(start)
    return rivals[:MOST_RIVALS]


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
