# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps 3 and 4 of one frame: near a belief, in the window about it, or on the whole map."""

from __future__ import annotations

from dataclasses import dataclass, replace

from gip_localizer.core.belief import Belief
from gip_localizer.core.estimate import Match
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.core.search.global_search import global_search
from gip_localizer.core.search.local_search import around_winner, search_window, SearchResult
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import (
    configured_window,
    first_fix_window,
    SearchWindow,
    tracking_window,
)
from gip_localizer.parameters import Parameters


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
    map_noise : float
        Standard deviation of the map in the view's grey levels, as in the Gramian.

    """

    match: Match
    crops: MapCrops
    refiner: Refiner
    parameters: Parameters
    map_noise: float

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
            refiner=self.refiner, map_noise=self.map_noise,
        )

    def _within(self, prior: Belief, extent: SearchWindow) -> SearchResult | None:
        return search_window(
            self.match.view, self.match.weight, self.crops, prior, extent,
            refiner=self.refiner, normalized=self.parameters.score.normalized,
            map_noise=self.map_noise,
        )
