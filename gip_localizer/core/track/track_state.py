# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How firmly the belief stands: fresh, to be confirmed, confirmed, lost, or searched for."""

from __future__ import annotations

import math

from gip_localizer.parameters import Parameters


class TrackState:
    """
    Counts what the frames said.

    Parameters
    ----------
    parameters : Parameters
        When a belief counts as lost, how often the map is searched, and how many frames must
        confirm a place that was found; replace them with `configure`.

    Attributes
    ----------
    misses : int
        Frames in a row without a fix.
    unconfirmed : int
        Agreeing frames that a place found on the map still needs.
    fresh : bool
        The belief comes from outside, and no frame has matched yet.
    wanted : bool
        The map is to be searched.

    """

    def __init__(self, parameters: Parameters) -> None:
        self.configure(parameters)
        self._searched_ns: int | None = None
        self.wanted = False
        self.started()

    def configure(self, parameters: Parameters) -> None:
        """Take new limits."""
        self._lost_after = parameters.integrity.lost_after
        self._recovery = parameters.recovery

    def started(self) -> None:
        """Begin again: what is believed, if anything, comes from outside."""
        self.misses = 0
        self.unconfirmed = 0
        self.fresh = True

    def search(self) -> None:
        """Want the whole map searched from the next frame on, until a place is confirmed."""
        self.wanted = True
        self._searched_ns = None

    @property
    def lost(self) -> bool:
        """Whether too many frames in a row gave no fix."""
        return self.misses >= self._lost_after

    @property
    def confirmed(self) -> bool:
        """Whether the belief rests on published fixes."""
        return not (self.fresh or self.unconfirmed or self.lost)

    def search_due(self, stamp_ns: int) -> bool:
        """Whether a frame is looked for on the whole map."""
        if self.unconfirmed or not (self.wanted or (self.lost and self._recovery.automatic)):
            return False
        since = math.inf if self._searched_ns is None else stamp_ns - self._searched_ns
        return since < 0 or since >= self._recovery.period * 1e9

    def searched(self, stamp_ns: int) -> None:
        """Note that the whole map was searched for a frame."""
        self._searched_ns = stamp_ns

    def new_place(self, stamp_ns: int) -> bool:
        """Whether a fix at this frame is at a place that earlier frames do not vouch for."""
        return self._searched_ns == stamp_ns or self.lost

    def fixed(self, *, new_place: bool) -> None:
        """Note a match that is believed."""
        if new_place:
            self.unconfirmed = self._recovery.confirm_frames
        self.misses = 0
        self.fresh = False
        if self.unconfirmed:
            self.unconfirmed -= 1
            self.wanted = self.wanted and self.unconfirmed > 0

    def missed(self) -> None:
        """Note a frame without a match; an unconfirmed place is given up."""
        self.misses += 1
        if self.unconfirmed > 0:
            self.unconfirmed = 0
            self.misses = max(self.misses, self._lost_after)
