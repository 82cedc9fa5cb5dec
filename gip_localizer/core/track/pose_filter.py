# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The prior of each frame: the last pose moved by the motion model, and its fusion with each match.

A Kalman filter on (x, y, yaw). Without matches the covariance grows until the prior no longer
constrains the pose; a prediction is never published as a pose.

"""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.track.belief_arithmetic import (
    agree,
    excess_share,
    fused,
    moved,
    scaled_motion,
)
from gip_localizer.core.track.motion_model import (
    FilterState,
    MotionModel,
    VELOCITY_AGE_S,
    WITHOUT_ODOMETRY,
)
from gip_localizer.core.track.odometry import OdometryBuffer
from gip_localizer.core.track.odometry_check import OdometryCheck
from gip_localizer.parameters import Motion

# Number of standard deviations of a prediction within which the vehicle is assumed to be (design
# choice: 4, because a normally distributed error is larger only once in 16,000 frames).
REACH_SIGMAS = 4.0


class PoseFilter:
    """
    Keeps the belief between frames.

    Parameters
    ----------
    motion : Motion
        Noise of the motion between frames.

    Attributes
    ----------
    known : FilterState
        Belief, velocity and last fixes.

    """

    def __init__(self, motion: Motion) -> None:
        self._model = MotionModel(motion)
        self.known = FilterState()

    def __str__(self) -> str:
        """Return the belief and what it was predicted with."""
        if self.belief is None:
            return 'no belief'
        pose, sigma = self.belief.pose, np.sqrt(np.diag(self.belief.covariance))
        return (
            f'belief ({pose.x:.3f} m, {pose.y:.3f} m, {pose.yaw:.4f} rad) +- '
            f'({sigma[0]:.3f} m, {sigma[1]:.3f} m, {sigma[2]:.4f} rad), predicted by '
            f'{self.prediction_source}'
        )

    @property
    def belief(self) -> Belief | None:
        """The last fix, or a prediction since."""
        return self.known.belief

    @property
    def odometry(self) -> OdometryBuffer:
        """Recent odometry."""
        return self._model.odometry

    @property
    def odometry_check(self) -> OdometryCheck:
        """Whether the fixes confirm odometry."""
        return self._model.odometry_check

    @property
    def prediction_source(self) -> str:
        """Source of the motion to the last frame; `MotionModel.source`."""
        return self._model.source

    def restamp(self, stamp_ns: int) -> None:
        """Give the belief another stamp."""
        if self.belief is not None:
            belief = replace(self.belief, stamp_ns=stamp_ns)
            self.known = replace(self.known, belief=belief, origin=belief)

    def configure(self, motion: Motion) -> None:
        """Change the noise of the motion."""
        self._model.configure(motion)

    def reset(self, belief: Belief | None) -> None:
        """Start again from a belief, or from none."""
        self.known = FilterState(belief, origin=belief)
        if belief is None:
            self._model.odometry_check = OdometryCheck()

    def begin(self, fix: Belief) -> None:
        """
        Start again from a fix at a place that earlier fixes do not support.

        Two such fixes in a row give a velocity, which is needed because a search of the whole map
        takes longer than the time between frames.

        """
        self.known = FilterState(fix, last_fix=self.known.last_fix, origin=fix)
        self._learn_velocity(fix)

    def predict(self, stamp_ns: int) -> Belief | None:
        """Return the belief moved to a stamp; None without one."""
        if self.belief is None:
            return None
        elapsed = max((stamp_ns - self.belief.stamp_ns) * 1e-9, 0.0)
        motion, factor = self._model.motion(self.known, stamp_ns, elapsed)
        driven = self.belief.driven + math.hypot(motion.x, motion.y)
        since_fix = self.belief.since_fix + elapsed
        added = self._model.covariance(
            factor, (self.belief.driven, driven), (self.belief.since_fix, since_fix)
        )
        belief = moved(self.belief, stamp_ns, motion, added)
        return replace(belief, driven=driven, since_fix=since_fix)

    def predict_unproven(self, stamp_ns: int) -> Belief | None:
        """
        Return the last fix or given belief moved by odometry that no fix has confirmed yet.

        It is an additional place to search, and never narrows a search. None where odometry is
        confirmed, contradicted or missing.

        """
        origin, check = self.known.origin, self.odometry_check
        if origin is None or check.believed or check.rejected:
            return None
        motion = self.odometry.motion(origin.stamp_ns, stamp_ns)
        if motion is None:
            return None
        driven, seconds = math.hypot(motion.x, motion.y), (stamp_ns - origin.stamp_ns) * 1e-9
        added = self._model.covariance(WITHOUT_ODOMETRY, (0.0, driven), (0.0, seconds))
        belief = moved(origin, stamp_ns, motion, added)
        return replace(belief, driven=driven, since_fix=seconds)

    def moved_since(self, stamp_ns: int, now_ns: int) -> Pose2 | None:
        """Return the motion from one stamp to another as far as it is known without a match."""
        return self._model.between(self.known, stamp_ns, now_ns)

    def follows(self, prior: Belief, measured: Belief) -> bool:
        """
        Return whether the vehicle can have moved from the last fix to a match.

        Parameters
        ----------
        prior : Belief
            What `predict` returned for the match's stamp.
        measured : Belief
            The match.

        """
        distance, turn = self._model.largest_deviation(prior.since_fix)
        innovation = difference(measured.pose, prior.pose)
        innovation[:2] *= excess_share(math.hypot(innovation[0], innovation[1]), distance)
        innovation[2] *= excess_share(abs(innovation[2]), turn)
        return agree(innovation, prior.covariance + measured.covariance)

    def reach(self, prior: Belief) -> float:
        """Return the distance from a prediction (m) within which the vehicle may be."""
        distance, _ = self._model.largest_deviation(prior.since_fix)
        variance = float(max(prior.covariance[0, 0], prior.covariance[1, 1]))
        return REACH_SIGMAS * math.sqrt(variance) + distance

    def correct(self, prior: Belief, measured: Belief, *, fuse: bool) -> Belief:
        """
        Take a match into the belief and return it.

        Parameters
        ----------
        prior : Belief
            Prediction at the frame's stamp.
        measured : Belief
            The match; where it contradicts the prediction beyond the gate, it replaces it.
        fuse : bool
            False: the match always replaces the prediction.

        Returns
        -------
        Belief
            The new belief.

        """
        innovation = difference(measured.pose, prior.pose)
        total = prior.covariance + measured.covariance
        fusing = fuse and agree(innovation, total)
        belief = fused(prior, measured, innovation, total) if fusing else measured
        self._learn_velocity(belief)
        self.known = replace(self.known, belief=belief, origin=belief)
        return belief

    def miss(self, prior: Belief) -> None:
        """Continue from the prediction after a frame without a match."""
        self.known = replace(self.known, belief=prior)

    def _learn_velocity(self, fix: Belief) -> None:
        """Take velocity and confirmation of odometry from one more fix."""
        last, velocity = self.known.last_fix, self.known.velocity
        elapsed = 0.0 if last is None else (fix.stamp_ns - last.stamp_ns) * 1e-9
        if last is not None and 0.0 < elapsed < VELOCITY_AGE_S:
            measured = scaled_motion(last.pose.inverse() @ fix.pose, 1.0 / elapsed)
            if math.hypot(measured.x, measured.y) <= self._model.noise.max_speed:
                velocity = measured
        since = self.known.compared_since
        finished = since is None or self._model.compare(since, fix)
        self.known = replace(
            self.known, velocity=velocity, last_fix=fix,
            compared_since=fix if finished else since,
        )
