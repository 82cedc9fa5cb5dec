# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Steps 3 and 4 about one place: score a window of candidates, refine the best modes, keep one.

The lattice is scored on larger cells (`SearchWindow.cell`), whose sums lose nothing but
detail; the continuous refinement on the full view then gives the pose.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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
    modes,
    posterior_surface,
    PosteriorSurface,
)
from gip_localizer.core.match.score_surface import make_lattice, match, Scores
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.hypotheses import competitors, Hypothesis
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.core.threads import check_end

PEAKS = 8  # most peaks of a score surface that are considered; chosen
# Least fit score of a clear winner, next to which no other mode is refined; chosen.
PLAIN_WINNER = 1.0
PLAIN_DISPERSION = 2.2  # largest overdispersion of a clear winner; chosen
# Offsets along the weakest direction, m, from which a doubtful fit is repeated; chosen.
ASIDE = (-0.2, 0.2)
VALLEY = 3.0  # least anisotropy of a fit that is repeated from these offsets; chosen
# Largest pitch (rad) and least fit score at which the camera counts as at its calibrated pitch.
CALM = (0.002, 0.5)
HOPELESS = -40.0  # log posterior relative to the winner's, below which no mode is refined; chosen
MOST_BEYOND = 0.05  # largest distance of a match outside the searched window, m; chosen: one cell


@dataclass(frozen=True, eq=False)
class SearchResult:
    """
    What a search found.

    Attributes
    ----------
    scores : Scores
        The surface on the lattice.
    surface : PosteriorSurface or None
        Its posterior; None where no candidate overlaps the map enough.
    fits : list of Fit
        Refined modes, best first.

    """

    scores: Scores
    surface: PosteriorSurface | None
    fits: list[Fit]

    def beside(self, fits: list[Fit]) -> SearchResult:
        """Return it with what was found by another look, its competitors too."""
        return replace(self, fits=sorted([*self.fits, *fits], key=lambda fit: -fit.fit_score))

    @property
    def beyond(self) -> float:
        """How far the best fit lies outside the window, metres; negative inside."""
        lattice = self.scores.lattice
        off = difference(lattice.anchor.inverse() @ self.fits[0].pose, Pose2(0.0, 0.0, 0.0))
        return float(max(abs(off[0]) - lattice.half[0] * lattice.step,
                         abs(off[1]) - lattice.half[1] * lattice.step))

    @property
    def lies_beyond(self) -> bool:
        """Whether the best fit lies where nothing was compared with it."""
        return bool(self.fits) and self.beyond > MOST_BEYOND


def around_winner(
    found: SearchResult | None, search: Callable[[Pose2], SearchResult | None]
) -> SearchResult | None:
    """
    Return a search, or one more with all that is around its best fit if that lies beyond.

    The result of the first search is kept too: on repeated ground it holds the equal places.

    """
    if found is None or not found.lies_beyond:
        return found
    again = search(found.fits[0].pose)
    return again.beside(found.fits) if again is not None and again.fits else again


def coarse_factor(resolution: float, cell: float) -> int:
    """Return how many cells are averaged per side for a lattice of about `cell` metres."""
    return max(int(cell / resolution + 1e-6), 1)


def search_window(
    view: View, weight: Floats, crops: MapCrops, prior: Belief, extent: SearchWindow, *,
    refiner: Refiner, normalized: bool, errors: FrameErrors,
) -> SearchResult | None:
    """
    Find the best poses in a window about a prior.

    Parameters
    ----------
    view, weight : View, (rows, cols) float32
        Bird's-eye view and the Gramian's diagonal.
    crops : MapCrops
        Of the map.
    prior : Belief
        Centre of the window, and a prior on the candidates.
    extent : SearchWindow
        Size of the window.
    refiner : Refiner
        For the view's calibration.
    normalized : bool
        Whether gain and offset are profiled out.
    errors : FrameErrors
        What is known of them before the match.

    Returns
    -------
    SearchResult or None
        None where the window lies off the map.

    """
    check_end()
    fine = crops.about(view.grid, prior.pose, extent, view.grid.resolution)
    if fine is None:
        return None
    lay = partial(refiner.layers, view, weight, fine, errors)
    finer = lay(stages=slice(1, None))
    layers = cache(lambda: lay(stages=slice(1)) + finer)

    def refined(start: Pose2, *, pitch: float = 0.0, uneven: bool = False) -> Fit:
        return refiner.refine(layers(), start, pitch=pitch, uneven=uneven)

    scored = partial(_scored, view, weight, crops, prior, extent, refiner.camera, normalized)
    quickly = partial(refiner.refine, finer) if extent.near and len(finer) > 1 else None
    unevenly = partial(refined, uneven=True) if normalized else None
    window = _WindowSearch(scored, refined, quickly, unevenly)
    level, *pitched_views = refiner.pitches
    window.score(level)
    if not window.is_level():
        for pitch in pitched_views:
            window.score(pitch)
    window.refine(extent.modes)
    return window.found()


class _WindowSearch:
    """
    A window while it is searched.

    Parameters
    ----------
    scored : callable
        Scores and posterior of the window as if the camera were pitched by so much.
    refined : callable
        Fit from a pose, and a pitch.
    quickly : callable or None
        The same from near by; what it finds counts if it is plain.
    unevenly : callable or None
        Fit from a pose, and a pitch, under a light that varies over the road: tried where even
        light leaves a contradiction, and used from then on if it fits better.

    """

    def __init__(
        self, scored: Callable[[float], tuple[Scores, PosteriorSurface | None]],
        refined: Callable[..., Fit], quickly: Callable[..., Fit] | None,
        unevenly: Callable[..., Fit] | None,
    ) -> None:
        self._scored, self._refined, self._quickly = scored, refined, quickly
        self._unevenly, self._uneven = unevenly, False
        self._scores: list[Scores] = []
        self._hypotheses: list[Hypothesis] = []
        self._fits: dict[Hypothesis | Pose2, Fit] = {}

    def score(self, pitch: float) -> None:
        """Score the lattice for a pitch and keep its modes."""
        scores, surface = self._scored(pitch)
        self._scores.append(scores)
        if surface is not None:
            places = modes(surface, PEAKS)
            self._hypotheses += [Hypothesis(scores, surface, place, pitch) for place in places]
            self._hypotheses.sort(key=lambda start: start.residual)

    def refine(self, most: int) -> None:
        """Refine the best modes until one is plainly the winner."""
        worthy = [start for start in self._hypotheses if start.log_posterior > HOPELESS]
        any(_is_plain(self._fit(start)) for start in worthy[:most])

    def is_level(self) -> bool:
        """Whether the best mode is good, with the camera near its calibrated pitch."""
        if not self._hypotheses:
            return False
        start = self._hypotheses[0]
        if self._quickly is not None:
            quick = self._quickly(start.pose, pitch=start.pitch)
            fit = self._in_better_light(quick, start)
            if _is_plain(fit) or fit is not quick:
                self._fits[start] = fit
        fit = self._fit(start)
        calm = bool(abs(fit.camera_motion[0]) < CALM[0])
        return _is_plain(fit) or (calm and fit.fit_score > CALM[1])

    def found(self) -> SearchResult:
        """Repeat a doubtful winner from next to it, and refine its competitors."""
        if not self._fits:
            return SearchResult(self._scores[0], None, [])
        best = self._best()
        if self._may_be_one_of_several(best):
            for distance in ASIDE:
                aside = best.pose @ best.along_weakest(distance)
                self._fits[aside] = self._refined(aside)
            best = self._best()
        for start in competitors(self._hypotheses, best.pose):
            self._fit(start)
        fits = sorted(self._fits.values(), key=lambda fit: -fit.fit_score)
        return SearchResult(self._hypotheses[0].scores, self._hypotheses[0].surface, fits)

    def _may_be_one_of_several(self, best: Fit) -> bool:
        """Whether a fit may be one of several optima: in a valley, or contradicting itself."""
        if best.fit_score <= PLAIN_WINNER:
            return False
        if self._quickly is None and best.anisotropy > VALLEY:
            return True
        light_explains = self._uneven and self._quickly is not None
        return not (_is_plain(best) or light_explains)

    def _fit(self, start: Hypothesis) -> Fit:
        if start not in self._fits:
            fit = self._refined(start.pose, pitch=start.pitch)
            self._fits[start] = self._in_better_light(fit, start)
        return self._fits[start]

    def _in_better_light(self, fit: Fit, start: Hypothesis) -> Fit:
        """Look again under uneven light at the best start; the others follow it."""
        if self._unevenly is None or start is not self._hypotheses[0] or _is_plain(fit):
            return fit
        other = self._unevenly(start.pose, pitch=start.pitch)
        self._uneven = other.fit_score > fit.fit_score
        if self._uneven:
            self._refined = self._unevenly
        self._unevenly = None
        return other if self._uneven else fit

    def _best(self) -> Fit:
        return max(self._fits.values(), key=lambda fit: fit.fit_score)


def _is_plain(fit: Fit) -> bool:
    return fit.fit_score > PLAIN_WINNER and fit.overdispersion < PLAIN_DISPERSION


def _scored(
    view: View, weight: Floats, crops: MapCrops, prior: Belief, extent: SearchWindow,
    camera: CameraModel, normalized: bool, pitch: float,
) -> tuple[Scores, PosteriorSurface | None]:
    """Score the window as if the camera were pitched; no surface where nothing overlaps."""
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
    """Score the window on cells averaged up to `extent.cell`."""
    factor = coarse_factor(view.grid.resolution, extent.cell)
    larger, larger_weight = downsampled_view(view, weight, factor)
    step = larger.grid.resolution
    crop = crops.about(view.grid, anchor, extent, step)
    lattice = make_lattice(anchor, x=extent.x, y=extent.y, yaw=extent.yaw,
                           yaw_step=extent.yaw_step, step=step)
    part = crop.part if crop else crops.raster_map
    return match(larger, larger_weight, part, lattice, normalized=normalized,
                 min_overlap=extent.min_overlap, centred=normalized)
