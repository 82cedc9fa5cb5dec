# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps 3 and 4 of one frame: around a belief, in a small or a large window, or on the map."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.estimate import Match
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.fit import Fit, SAME_PLACE
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.expected_fit import ExpectedFit, FitReference
from gip_localizer.core.search.global_search import global_search
from gip_localizer.core.search.local_search import search_window
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.search_result import around_winner, SearchResult
from gip_localizer.core.search.window import (
    configured_window,
    equal_places_window,
    first_fix_window,
    MAX_REACH,
    SearchWindow,
    tracking_window,
)
from gip_localizer.parameters import Parameters

# Share of the best fit score (no unit) above which a place outside the window equals the match
# (measured: on a road of dashes every 6 m the next dash has 0.99; with an arrow in view 0.76 to
# 0.89).
EQUAL_SHARE = 0.9
# Share of the fit score of the match (no unit) above which a place found on coarse cells is
# searched again (design choice: 0.73, the limit on competitors of `integrity`).
CANDIDATE_SHARE = 0.73


@dataclass(frozen=True, eq=False)
class FrameSearch:
    """
    Searches of one frame.

    Attributes
    ----------
    match : Match
        View and weights of the frame.
    crops : MapCrops
        Parts of the map.
    refiner : Refiner
        Refiner of the calibration of the view.
    parameters : Parameters
        Windows, metric and search of the whole map.
    errors : FrameErrors
        Known errors of the frame.

    """

    match: Match
    crops: MapCrops
    refiner: Refiner
    parameters: Parameters
    errors: FrameErrors

    def near(self, prior: Belief, reference: FitReference | None = None) -> SearchResult | None:
        """
        Search the small window around a confirmed belief; None if it is outside the map.

        Parameters
        ----------
        prior : Belief
            Belief at the centre of the window.
        reference : FitReference or None
            A fit near the belief that is as good ends the search.

        """
        expected = None if reference is None else ExpectedFit(prior, reference)
        return self._within(prior, tracking_window(prior, self.parameters), expected)

    def about(self, prior: Belief, *, fresh: bool) -> SearchResult | None:
        """
        Search the window around a belief, and around a match outside it.

        Returns None if the window is outside the map.

        Parameters
        ----------
        prior : Belief
            Belief at the centre of the window.
        fresh : bool
            The belief is an initial pose, whose covariance may widen the window.

        """
        extent = (first_fix_window if fresh else configured_window)(prior, self.parameters)

        def search(pose: Pose2) -> SearchResult | None:
            return self._within(replace(prior, pose=pose), extent)

        return around_winner(search(prior.pose), search)

    def everywhere(self, stamp_ns: int) -> SearchResult | None:
        """Search the whole map; None if no place overlaps it."""
        return global_search(
            self.match.view, self.match.weight, self.crops, stamp_ns, self.parameters,
            refiner=self.refiner, errors=self.errors,
        )

    def with_equal_places(
        self, found: SearchResult, prior: Belief, reach: float
    ) -> SearchResult:
        """
        Return a result with the equally good places within reach of the vehicle.

        A place that matches better becomes the best fit.

        Parameters
        ----------
        found : SearchResult
            A result with at least one fit.
        prior : Belief
            Prediction at the stamp of the frame.
        reach : float
            Distance (m) from the prediction within which the vehicle may be. Above `MAX_REACH`
            only the surroundings of the best fit are searched.

        """
        half, middle = reach, prior.pose
        if reach > MAX_REACH:
            half, middle = MAX_REACH, found.fits[0].pose
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
        return best.with_fits([
            fit for fit in (search.fits[0] for search in searches)
            if fit.distance(winner) > SAME_PLACE
            and fit.fit_score > EQUAL_SHARE * winner.fit_score
        ])

    def _within(
        self, prior: Belief, extent: SearchWindow, expected: ExpectedFit | None = None
    ) -> SearchResult | None:
        return search_window(
            self.match.view, self.match.weight, self.crops, prior, extent,
            refiner=self.refiner, normalized=self.parameters.score.normalized,
            errors=self.errors, expected=expected,
        )


def _other_places(found: SearchResult, fits: list[Fit]) -> list[Pose2]:
    """Return the places, each once, that match nearly as well and are not among the fits."""
    least = CANDIDATE_SHARE * found.fits[0].fit_score
    known = list(found.fits)
    places: list[Pose2] = []
    for fit in fits:
        if fit.fit_score > least and all(fit.distance(other) > SAME_PLACE for other in known):
            known.append(fit)
            places.append(fit.pose)
    return places
