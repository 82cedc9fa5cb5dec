# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
All state of a drive that is kept from frame to frame, in one object that can be printed.

The tracking state machine (initialized, confirming, tracking, lost, relocalizing), the belief and
the odometry, the gain of the image, and the time order of the frames.

"""

from __future__ import annotations

from dataclasses import replace
from enum import Enum
import math

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.search.expected_fit import FitReference
from gip_localizer.core.track.motion_model import FilterState
from gip_localizer.core.track.pose_filter import PoseFilter
from gip_localizer.core.track.stamp_check import StampCheck
from gip_localizer.parameters import Parameters

# Stamp (ns) of a belief that is valid at the next frame, whatever its stamp (design choice: a
# number that no clock reports).
NOW = -(1 << 62)


class Phase(str, Enum):
    """Phase of the tracking state machine."""

    UNINITIALIZED = 'uninitialized'
    INITIALIZED = 'initialized'
    CONFIRMING = 'confirming'
    TRACKING = 'tracking'
    LOST = 'lost'
    RELOCALIZING = 'relocalizing'


class TrackState:
    """
    State of one drive.

    Parameters
    ----------
    parameters : Parameters
        Initial pose, noise of the motion, number of misses before the track is lost, period of the
        searches of the whole map, and number of frames that must confirm a place that was found.

    Attributes
    ----------
    pose_filter : PoseFilter
        Belief, velocity and odometry.
    stamps : StampCheck
        Time order of the frames.
    gain : float or None
        Gain of the image relative to the map at the last match; None before the first match with
        this calibration.
    error_level : ErrorLevel
        Level of the smooth errors of road, map and calibration, from the matches with this
        calibration.
    reference : FitReference or None
        How well the last fix fitted that was compared with the other modes; None before it.
    misses : int
        Consecutive frames without a fix.
    unconfirmed : int
        Agreeing frames that a place found by a search of the whole map still needs.
    from_initialpose : bool
        The belief is an initial pose, and no frame has matched since.
    search_requested : bool
        A search of the whole map was requested, and no place has been confirmed since.

    """

    def __init__(self, parameters: Parameters) -> None:
        self._parameters = parameters
        self.pose_filter = PoseFilter(parameters.motion)
        self.stamps = StampCheck()
        self.gain: float | None = None
        self.error_level = ErrorLevel()
        self.reference: FitReference | None = None
        self.search_requested = False
        self._searched_ns: int | None = None
        self._before_suspect = FilterState()
        self.restart()

    def __str__(self) -> str:
        """Return phase, belief, gain and time order in one line."""
        gain = 'unknown' if self.gain is None else f'{self.gain:.3f}'
        return (
            f'{self.phase.value} (misses {self.misses}, unconfirmed {self.unconfirmed}); '
            f'{self.pose_filter}; gain {gain}; {self.stamps}'
        )

    @property
    def phase(self) -> Phase:
        """Phase of the state machine."""
        if self.unconfirmed:
            return Phase.CONFIRMING
        if self.search_requested:
            return Phase.RELOCALIZING
        if self.lost:
            return Phase.LOST
        if self.pose_filter.belief is None:
            return Phase.UNINITIALIZED
        return Phase.INITIALIZED if self.from_initialpose else Phase.TRACKING

    def configure(self, parameters: Parameters) -> None:
        """Take new parameters; the belief stays."""
        self._parameters = parameters
        self.pose_filter.configure(parameters.motion)

    def restart(self) -> None:
        """Start again from the initial pose of the parameters, or from no pose at all."""
        pose = self._parameters.initial_pose
        self.pose_filter.reset(None)
        self._begin()
        if pose.set:
            covariance = np.diag([pose.sigma_xy**2, pose.sigma_xy**2, pose.sigma_yaw**2])
            self.pose_filter.reset(Belief(NOW, Pose2(pose.x, pose.y, pose.yaw), covariance))

    def start_from(self, prior: Belief) -> None:
        """Start again from an initial pose; its stamp 0 means now."""
        if prior.stamp_ns == 0 or self.stamps.is_long_past(prior.stamp_ns):
            prior = replace(prior, stamp_ns=NOW)
        self.pose_filter.reset(prior)
        self._begin()
        self.search_requested = False
        self.stamps = StampCheck()
        self.gain = None

    def forget_calibration(self) -> None:
        """Forget the gain and the level of the smooth errors, which depend on the calibration."""
        self.gain = None
        self.error_level = ErrorLevel()
        self.reference = None

    def _begin(self) -> None:
        self.misses = 0
        self.unconfirmed = 0
        self.reference = None
        self.from_initialpose = True

    def request_search(self) -> None:
        """Search the whole map from the next frame on, until a place is confirmed."""
        self.search_requested = True
        self._searched_ns = None

    def take_stamp(self, stamp_ns: int) -> str:
        """Take the stamp of a frame; return why it is refused, or an empty string."""
        fault = self.stamps.fault(stamp_ns)
        if fault:
            return fault
        if self.stamps.suspect:
            self._before_suspect = self.pose_filter.known
        elif self.stamps.returned:
            self.pose_filter.known = self._before_suspect
        elif self.stamps.went_back:
            self.restart()
            self.pose_filter.odometry.clear()
        return ''

    def predict(self, stamp_ns: int) -> Belief | None:
        """Return the belief at the stamp of a frame; None without one."""
        belief = self.pose_filter.belief
        if belief is not None and (belief.stamp_ns == NOW or belief.stamp_ns > stamp_ns):
            self.pose_filter.restamp(stamp_ns)
        return self.pose_filter.predict(stamp_ns)

    @property
    def lost(self) -> bool:
        """Whether too many consecutive frames gave no fix."""
        return self.misses >= self._parameters.integrity.lost_after

    @property
    def confirmed(self) -> bool:
        """Whether published fixes confirm the belief."""
        return not (self.from_initialpose or self.unconfirmed or self.lost)

    def search_due(self, stamp_ns: int) -> bool:
        """Whether the whole map is to be searched for a frame."""
        recovery = self._parameters.recovery
        wanted = self.search_requested or (self.lost and recovery.automatic)
        if self.unconfirmed or not wanted:
            return False
        since = math.inf if self._searched_ns is None else stamp_ns - self._searched_ns
        return since < 0 or since >= recovery.period * 1e9

    def searched(self, stamp_ns: int) -> None:
        """Record that the whole map was searched for a frame."""
        self._searched_ns = stamp_ns

    def accept(
        self, prior: Belief | None, match: Belief, *, gain: float, error_level: ErrorLevel
    ) -> Belief:
        """
        Update the state with an accepted match.

        Parameters
        ----------
        prior : Belief or None
            Result of `predict` for the frame.
        match : Belief
            The match at the frame's stamp.
        gain : float
            Gain of the image relative to the map at the match.
        error_level : ErrorLevel
            Level of the smooth errors after the match.

        Returns
        -------
        Belief
            The match fused with the prior, or the match alone where no fix supports the prior.

        """
        self.gain = gain
        self.error_level = error_level
        new_place = self._is_new_place(prior, match)
        if new_place:
            self.unconfirmed = self._parameters.recovery.confirm_frames
            self.pose_filter.begin(match)
        elif prior is not None:
            match = self.pose_filter.correct(prior, match, fuse=self._parameters.motion.fuse)
        self.misses = 0
        self.from_initialpose = False
        if self.unconfirmed:
            self.unconfirmed -= 1
            self.search_requested = self.search_requested and self.unconfirmed > 0
        return match

    def _is_new_place(self, prior: Belief | None, match: Belief) -> bool:
        """Whether earlier frames do not support the place of a match."""
        if self._searched_ns == match.stamp_ns or self.lost:
            return True
        if self.unconfirmed == 0 or prior is None:
            return False
        return not self.pose_filter.follows(prior, match)

    def miss(self, prior: Belief | None) -> None:
        """Count a frame without a match, and discard a place that is not confirmed yet."""
        self.misses += 1
        if self.unconfirmed > 0:
            self.unconfirmed = 0
            self.misses = max(self.misses, self._parameters.integrity.lost_after)
        if prior is not None:
            self.pose_filter.miss(prior)
