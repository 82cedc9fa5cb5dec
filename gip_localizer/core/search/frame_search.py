# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps 3 and 4 of one frame: near a belief, in the window about it, or on the whole map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.estimate import Match
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.fit import Fit, SAME_PLACE
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.global_search import global_search
from gip_localizer.core.search.local_search import around_winner, search_window, SearchResult
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import (
    configured_window,
    equal_places_window,
    first_fix_window,
    MOST_REACH,
    SearchWindow,
    tracking_window,
)
from gip_localizer.parameters import Parameters

# Share of the best fit score from which a place outside the window is its equal: on a road of
# dashes 6 m apart the next dash has 0.99; with an arrow in view 0.76 to 0.89.
EQUAL_SHARE = 0.9
CANDIDATE_SHARE = 0.73  # of a fit score, from which a coarsely found place is searched around


@dataclass(frozen=True, eq=False)
class FrameSearch:
    """
    The search of one frame.

    Attributes
    ----------
    match : Match
        View and weights.
    crops : MapCrops
        Of the map.
    refiner : Refiner
        For the view's calibration.
    parameters : Parameters
        Windows, metric, recovery.
    errors : FrameErrors
        What is known of them before the match.

    """

    match: Match
    crops: MapCrops
    refiner: Refiner
    parameters: Parameters
    errors: FrameErrors

    def near(self, prior: Belief) -> SearchResult | None:
        """Search what a belief that fixes confirm leaves open; None off the map."""
        return self._within(prior, tracking_window(prior, self.parameters))

    def about(self, prior: Belief, *, fresh: bool) -> SearchResult | None:
        """
        Search the window about a belief, and around a match outside it; None off the map.

        Parameters
        ----------
        prior : Belief
            The window's middle.
        fresh : bool
            It is from outside, and its covariance may widen the window.

        """
        extent = (first_fix_window if fresh else configured_window)(prior, self.parameters)

        def search(pose: Pose2) -> SearchResult | None:
            return self._within(replace(prior, pose=pose), extent)

        return around_winner(search(prior.pose), search)

    def everywhere(self, stamp_ns: int) -> SearchResult | None:
        """Search the whole map; None where no place matches at all."""
        return global_search(
            self.match.view, self.match.weight, self.crops, stamp_ns, self.parameters,
            refiner=self.refiner, errors=self.errors,
        )

    def with_equal_places(
        self, found: SearchResult, prior: Belief, reach: float
    ) -> SearchResult:
        """
        Return a search with the places that match as well, wherever the vehicle may be.

        A place that matches better takes the place of the best fit.

        Parameters
        ----------
        found : SearchResult
            A search with at least one fit.
        prior : Belief
            Prediction at the frame's stamp.
        reach : float
            Distance from it (m) at which the vehicle may be. Beyond `MOST_REACH` only the
            surroundings of the best fit are searched.

        """
        half, middle = reach, prior.pose
        if reach > MOST_REACH:
            half, middle = MOST_REACH, found.fits[0].pose
        window = equal_places_window(half, self.parameters)
        spread = np.diag([half**2, half**2, window.yaw**2])
        wide = self._within(Belief(prior.stamp_ns, middle, spread), window)
        searches = [found]
        for place in _other_places(found, wide.fits if wide is not None else []):
            again = self.about(replace(prior, pose=place), fresh=False)
            if again is not None and again.fits:
                searches.append(again)
        best = max(searches, key=lambda search: search.fits[0].fit_score)
        winner = best.fits[0]
        return best.beside([
            fit for fit in (search.fits[0] for search in searches)
            if fit.distance(winner) > SAME_PLACE
            and fit.fit_score > EQUAL_SHARE * winner.fit_score
        ])

    def _within(self, prior: Belief, extent: SearchWindow) -> SearchResult | None:
        return search_window(
            self.match.view, self.match.weight, self.crops, prior, extent,
            refiner=self.refiner, normalized=self.parameters.score.normalized,
            errors=self.errors,
        )


def _other_places(found: SearchResult, fits: list[Fit]) -> list[Pose2]:
    """Return the places, each once, that match nearly as well and were not yet compared."""
    least = CANDIDATE_SHARE * found.fits[0].fit_score
    known = list(found.fits)
    places: list[Pose2] = []
    for fit in fits:
        if fit.fit_score > least and all(fit.distance(other) > SAME_PLACE for other in known):
            known.append(fit)
            places.append(fit.pose)
    return places
