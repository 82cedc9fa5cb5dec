# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on a frame that follow from the state of the track, not from the match alone."""

from __future__ import annotations

from dataclasses import replace

from gip_localizer.core.estimate import Status
from gip_localizer.core.integrity import Verdict
from gip_localizer.core.track.track_state import TrackState
from gip_localizer.parameters import Recovery


def without_search(state: TrackState, recovery: Recovery) -> Verdict:
    """Return why no place is searched for a frame without a prior."""
    if state.search_requested:
        return Verdict(Status.LOST, (
            'not found on the map; the next search is due recovery.period '
            f'{recovery.period:g} s after the last one'
        ))
    return Verdict(Status.NO_PRIOR, (
        'no prior yet: publish initialpose, set initial_pose.*, or call ~/relocalize'
    ))


def of_miss(state: TrackState, verdict: Verdict) -> Verdict:
    """Return the verdict of a frame without a fix, or LOST after too many of them."""
    if not state.lost:
        return verdict
    return replace(verdict, status=Status.LOST, reason=(
        f'{state.misses} frames without a fix; last: {verdict.status}, {verdict.reason}'
    ))


def of_fix(state: TrackState, verdict: Verdict) -> Verdict:
    """Return the verdict of a frame with a fix, or CONFIRMING until enough frames agree."""
    if state.unconfirmed == 0:
        return verdict
    return replace(verdict, status=Status.CONFIRMING, reason=(
        f'found on the map; {state.unconfirmed} more agreeing frames are needed'
    ))
