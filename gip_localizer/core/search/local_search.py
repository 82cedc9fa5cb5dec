# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Steps 3 and 4 in one window: score the candidates, refine the best modes, order the fits.

The lattice is scored on larger cells (`SearchWindow.cell`), which lose only detail; the continuous
refinement on all cells of the view then gives the pose.

"""

from __future__ import annotations

from functools import cache, partial

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.birdseye.suspension import pitched
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.match.downsampling import downsampled_view
from gip_localizer.core.match.posterior import (
    independent_cells,
    posterior_surface,
    PosteriorSurface,
)
from gip_localizer.core.match.score_surface import make_lattice, match, Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.expected_fit import ExpectedFit
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.search_result import SearchResult
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.core.search.window_search import WindowSearch
from gip_localizer.core.threads import check_end


def coarse_factor(resolution: float, cell: float) -> int:
    """Return how many cells are averaged per side for a lattice of about `cell` metres."""
    return max(int(cell / resolution + 1e-6), 1)


def search_window(
    view: View, weight: Floats, crops: MapCrops, prior: Belief, extent: SearchWindow, *,
    refiner: Refiner, normalized: bool, errors: FrameErrors, expected: ExpectedFit | None = None,
) -> SearchResult | None:
    """
    Find the best poses in a window around a prior.

    Parameters
    ----------
    view, weight : View, (rows, cols) float32
        Bird's-eye view, and weight per cell.
    crops : MapCrops
        Parts of the map.
    prior : Belief
        Centre of the window, and a prior on the candidates.
    extent : SearchWindow
        Size of the window.
    refiner : Refiner
        Refiner of the calibration of the view.
    normalized : bool
        Whether gain and offset are profiled out.
    errors : FrameErrors
        Known errors of the frame.
    expected : ExpectedFit or None
        What the fit of a tracked frame is expected to be.

    Returns
    -------
    SearchResult or None
        None if the window is outside the map.

    """
    check_end()
    fine = crops.about(view.grid, prior.pose, extent, view.grid.resolution)
    if fine is None:
        return None
    prepare = partial(refiner.layers, view, weight, fine, errors)
    finer = prepare(stages=slice(1, None))
    layers = cache(lambda: prepare(stages=slice(1)) + finer)

    def refine(start: Pose2, *, pitch: float = 0.0, uneven: bool = False) -> Fit:
        return refiner.refine(layers(), start, pitch=pitch, uneven=uneven)

    scored = partial(_scored, view, weight, crops, prior, extent, refiner.camera, normalized)
    refine_near = partial(refiner.refine, finer) if extent.near and len(finer) > 1 else None
    refine_uneven = partial(refine, uneven=True) if normalized else None
    window = WindowSearch(scored, refine, refine_near, refine_uneven, expected)
    level, *pitched_views = refiner.pitches
    window.score(level)
    if window.find_expected():
        return window.expected_result()
    if not window.is_level():
        for pitch in pitched_views:
            window.score(pitch)
    window.refine(extent.modes)
    return window.result()


def _scored(
    view: View, weight: Floats, crops: MapCrops, prior: Belief, extent: SearchWindow,
    camera: CameraModel, normalized: bool, pitch: float,
) -> tuple[Scores, PosteriorSurface | None]:
    """Score the window for a pitch of the camera; no surface if no candidate overlaps the map."""
    moved, moved_weight = pitched(camera, view, weight, pitch)
    scores = lattice_scores(
        moved, moved_weight, crops, prior.pose, extent, normalized=normalized
    )
    if not np.isfinite(scores.residual).any():
        return scores, None
    return scores, posterior_surface(scores, independent_cells(weight), prior)


def lattice_scores(
    view: View, weight: Floats, crops: MapCrops, anchor: Pose2, extent: SearchWindow, *,
    normalized: bool,
) -> Scores:
    """Return scores of the window on cells averaged to at most `extent.cell`."""
    factor = coarse_factor(view.grid.resolution, extent.cell)
    larger, larger_weight = downsampled_view(view, weight, factor)
    step = larger.grid.resolution
    crop = crops.about(view.grid, anchor, extent, step)
    lattice = make_lattice(anchor, x=extent.x, y=extent.y, yaw=extent.yaw,
                           yaw_step=extent.yaw_step, step=step)
    part = crop.part if crop else crops.raster_map
    return match(larger, larger_weight, part, lattice, normalized=normalized,
                 min_overlap=extent.min_overlap, centred=normalized)
