# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Order of the searches of one frame; each result is judged before the next search.

A track that fixes confirm is searched in a small window around the prior. Only where this fails,
and before the first fix, the larger window of `search.*` or the whole map is searched.

"""

from __future__ import annotations

from gip_localizer.core.belief import Belief
from gip_localizer.core.estimate import Status
from gip_localizer.core.integrity import judge, Verdict
from gip_localizer.core.search.expected_fit import FitReference
from gip_localizer.core.search.frame_search import FrameSearch
from gip_localizer.core.search.search_result import SearchResult
from gip_localizer.core.track.track_state import TrackState
from gip_localizer.parameters import Parameters

Outcome = tuple[SearchResult | None, Verdict]
"""Result of a search (None: nothing was searched) and the verdict on it."""


class JudgedSearch:
    """
    Searches of one frame in the order that the state of the track requires.

    Parameters
    ----------
    search : FrameSearch
        Search of the frame.
    state : TrackState
        State of the drive; a search of the whole map is recorded in it.
    parameters : Parameters
        Limits of publication.

    """

    def __init__(self, search: FrameSearch, state: TrackState, parameters: Parameters) -> None:
        self._search = search
        self._state = state
        self._parameters = parameters
        self._supporting: Belief | None = None

    def best(self, stamp_ns: int, prior: Belief | None) -> Outcome:
        """Search around the prior or the whole map; `prior` is the prediction at the stamp."""
        self._supporting = supporting = prior if self._state.confirmed else None
        if self._search.match.contrast < self._parameters.integrity.min_contrast:
            return self._judged(None)
        if supporting is not None:
            near = self._judged(self._search.near(supporting, self._state.reference))
            if near[1].status is Status.TRACKING and near[1].expected:
                self._refer_to(near)
                return near
        found, verdict = self._first_match(stamp_ns, prior)
        if found is None or prior is None or verdict.status is not Status.TRACKING:
            return found, verdict
        reach = self._state.pose_filter.reach(prior)
        return self._judged(self._search.with_equal_places(found, prior, reach))

    def _refer_to(self, near: Outcome) -> None:
        """Compare the next frames with a fix that was compared with the other modes."""
        found, fit = near[0], near[1].fit
        if found is not None and fit is not None and found.compared:
            self._state.reference = FitReference(fit.fit_score, fit.overdispersion)

    def _first_match(self, stamp_ns: int, prior: Belief | None) -> Outcome:
        """Search the whole map, or around the belief and then where unproven odometry leads to."""
        if prior is None or self._state.search_due(stamp_ns):
            self._state.searched(stamp_ns)
            return self._judged(self._search.everywhere(stamp_ns))
        outcome = self._judged(self._search.about(prior, fresh=self._state.from_initialpose))
        unproven = self._state.pose_filter.predict_unproven(stamp_ns)
        if outcome[1].status is not Status.TRACKING and unproven is not None:
            return self._judged(self._search.about(unproven, fresh=True))
        return outcome

    def _judged(self, found: SearchResult | None) -> Outcome:
        match, prior = self._search.match, self._supporting
        return found, judge(match, found, self._parameters, prior=prior)
