# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The prior: last pose moved by odometry, and its fusion with each match.

A Kalman filter on (x, y, yaw). Without odometry the velocity of the last fixes is held for a
while. What is not known of the motion grows with the way and the time since the last fix, however
many frames lie between, until the prior says nothing; it never turns into a pose by itself.

"""

from __future__ import annotations

from dataclasses import dataclass, replace
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.track.belief_arithmetic import agree, beyond, fused, moved, scaled
from gip_localizer.core.track.odometry import MAX_TURN, OdometryBuffer
from gip_localizer.core.track.odometry_check import (
    MAX_ACCELERATION,
    MAX_TURN_ACCELERATION,
    OdometryCheck,
)
from gip_localizer.parameters import Motion

REACH_SIGMAS = 4.0  # of a prediction, within which the vehicle is
HELD_VELOCITY_S = 2.0  # longest time since a fix for which its velocity is held
BLIND = 5.0  # times as much drift with time where odometry does not tell the motion






@dataclass(frozen=True, eq=False)
class FilterState:
    """
    What fixes and motion tell.

    Attributes
    ----------
    belief : Belief or None
        The last fix, or a prediction since.
    velocity : Pose2 or None
        Of the last fixes, per second, base axes.
    last_fix, compared_since : Belief or None
        The last fix, and the one since which odometry is compared with the fixes.
    origin : Belief or None
        What `belief` was predicted from: the last fix, or the belief given from outside.

    """

    belief: Belief | None = None
    velocity: Pose2 | None = None
    last_fix: Belief | None = None
    compared_since: Belief | None = None
    origin: Belief | None = None




class PoseFilter:
    """
    Keeps the belief between frames.

    Parameters
    ----------
    motion : Motion
        Noise of the motion between frames.

    """

    def __init__(self, motion: Motion) -> None:
        self._noise = motion
        self.odometry = OdometryBuffer(motion)
        self.odometry_check = OdometryCheck()
        self.known = FilterState()
        self.prediction_source = 'none'

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

    def restamp(self, stamp_ns: int) -> None:
        """Let the belief hold at another stamp."""
        if self.belief is not None:
            belief = replace(self.belief, stamp_ns=stamp_ns)
            self.known = replace(self.known, belief=belief, origin=belief)

    def configure(self, motion: Motion) -> None:
        """Change the noise of the motion."""
        self._noise = motion
        self.odometry.limits = motion

    def reset(self, belief: Belief | None) -> None:
        """Start again from a belief, or from none."""
        self.known = FilterState(belief, origin=belief)
        if belief is None:
            self.odometry_check = OdometryCheck()

    def begin(self, fix: Belief) -> None:
        """
        Start again from a fix at a place that earlier ones do not vouch for.

        Two of them in a row tell a velocity: a vehicle that drives is elsewhere when the search
        of the whole map is over.

        """
        self.known = FilterState(fix, last_fix=self.known.last_fix, origin=fix)
        self._learn_velocity(fix)

    def predict(self, stamp_ns: int) -> Belief | None:
        """Return the belief moved to a stamp; None without one."""
        if self.belief is None:
            return None
        elapsed = max((stamp_ns - self.belief.stamp_ns) * 1e-9, 0.0)
        motion, blind = self._motion(stamp_ns, elapsed)
        driven = self.belief.driven + math.hypot(motion.x, motion.y)
        unseen = self.belief.unseen + elapsed
        drift = self._drift(blind, (self.belief.driven, driven), (self.belief.unseen, unseen))
        return replace(moved(self.belief, stamp_ns, motion, drift), driven=driven, unseen=unseen)

    def predict_unproven(self, stamp_ns: int) -> Belief | None:
        """
        Return the last fix or given belief moved by odometry that no fix has confirmed yet.

        It is one more place to look at, and never narrows a search. None where odometry is
        believed, contradicted or missing.

        """
        origin, check = self.known.origin, self.odometry_check
        if origin is None or check.believed or check.rejected:
            return None
        motion = self.odometry.motion(origin.stamp_ns, stamp_ns)
        if motion is None:
            return None
        driven, seconds = math.hypot(motion.x, motion.y), (stamp_ns - origin.stamp_ns) * 1e-9
        drift = self._drift(BLIND, (0.0, driven), (0.0, seconds))
        return replace(moved(origin, stamp_ns, motion, drift), driven=driven, unseen=seconds)

    def _motion(self, stamp_ns: int, elapsed: float) -> tuple[Pose2, float]:
        """Return the motion since the belief, and times how much drift with time it has."""
        assert self.belief is not None
        measured = self.odometry.motion(self.belief.stamp_ns, stamp_ns)
        held = self._held_motion(elapsed, stamp_ns)
        if measured is not None and self.odometry_check.usable(measured, held, elapsed):
            self.prediction_source = 'odometry'
            return measured, 1.0
        if held is not None:
            self.prediction_source = 'constant velocity'
            return held, BLIND
        self.prediction_source = 'standstill'
        return Pose2(0.0, 0.0, 0.0), BLIND

    def _held_motion(self, elapsed: float, now_ns: int) -> Pose2 | None:
        """Return the motion of so many seconds up to now; None long after the last fix."""
        velocity, fix = self.known.velocity, self.known.last_fix
        if velocity is None or fix is None or (now_ns - fix.stamp_ns) * 1e-9 >= HELD_VELOCITY_S:
            return None
        return scaled(velocity, elapsed)

    def moved_since(self, stamp_ns: int, now_ns: int) -> Pose2 | None:
        """Return the motion from one stamp to another as far as it is known without a match."""
        measured = self.odometry.motion(stamp_ns, now_ns)
        if measured is not None and not self.odometry_check.rejected:
            return measured
        return self._held_motion((now_ns - stamp_ns) * 1e-9, now_ns)

    def _drift(
        self, blind: float, driven: tuple[float, float], unseen: tuple[float, float]
    ) -> Floats:
        """Covariance (3, 3) of a part of the way since a fix, told in metres and seconds."""
        noise = self._noise
        far, long = (end**2 - start**2 for start, end in (driven, unseen))
        xy = noise.sigma_xy_per_m**2 * far + (blind * noise.sigma_xy_per_s) ** 2 * long
        yaw = noise.sigma_yaw_per_m**2 * far + (blind * noise.sigma_yaw_per_s) ** 2 * long
        return np.diag([xy, xy, yaw])

    def follows(self, prior: Belief, measured: Belief) -> bool:
        """
        Tell whether a vehicle can have come from the last fix to a match.

        Parameters
        ----------
        prior : Belief
            What `predict` returned for the match's stamp.
        measured : Belief
            The match.

        """
        reach, turn = self._reach(prior.unseen)
        innovation = difference(measured.pose, prior.pose)
        innovation[:2] *= beyond(math.hypot(innovation[0], innovation[1]), reach)
        innovation[2] *= beyond(abs(innovation[2]), turn)
        return agree(innovation, prior.covariance + measured.covariance)

    def reach(self, prior: Belief) -> float:
        """Return the distance from a prediction (m) at which the vehicle may be."""
        freedom, _ = self._reach(prior.unseen)
        variance = float(max(prior.covariance[0, 0], prior.covariance[1, 1]))
        return REACH_SIGMAS * math.sqrt(variance) + freedom

    def _reach(self, seconds: float) -> tuple[float, float]:
        """Metres and radians that the motion since a fix may differ from the predicted one."""
        if self.prediction_source == 'odometry':
            return 0.0, 0.0
        if self.prediction_source == 'constant velocity':
            return MAX_ACCELERATION * seconds**2, MAX_TURN_ACCELERATION * seconds**2
        return self._noise.max_speed * seconds, MAX_TURN * seconds

    def correct(self, prior: Belief, measured: Belief, *, fuse: bool) -> Belief:
        """
        Take a match into the belief and return it.

        Parameters
        ----------
        prior : Belief
            Prediction at the frame's stamp.
        measured : Belief
            The match; where it contradicts the prediction beyond the gate it stands alone.
        fuse : bool
            False: the match stands alone.

        Returns
        -------
        Belief
            What is believed now.

        """
        innovation = difference(measured.pose, prior.pose)
        total = prior.covariance + measured.covariance
        fusing = fuse and agree(innovation, total)
        belief = fused(prior, measured, innovation, total) if fusing else measured
        self._learn_velocity(belief)
        self.known = replace(self.known, belief=belief, origin=belief)
        return belief

    def miss(self, prior: Belief) -> None:
        """Carry the prediction on where a frame gave no match."""
        self.known = replace(self.known, belief=prior)

    def _learn_velocity(self, fix: Belief) -> None:
        last, velocity = self.known.last_fix, self.known.velocity
        elapsed = 0.0 if last is None else (fix.stamp_ns - last.stamp_ns) * 1e-9
        if last is not None and 0.0 < elapsed < HELD_VELOCITY_S:
            seen = scaled(last.pose.inverse() @ fix.pose, 1.0 / elapsed)
            if math.hypot(seen.x, seen.y) <= self._noise.max_speed:
                velocity = seen
        self.known = replace(self.known, velocity=velocity, last_fix=fix)
        self._compare(fix)

    def _compare(self, fix: Belief) -> None:
        """Hold odometry against the fixes."""
        since = self.known.compared_since
        told = None
        if since is not None:
            told = self.odometry.motion(since.stamp_ns, fix.stamp_ns)
        if since is None or told is None:
            self.known = replace(self.known, compared_since=fix)
            return
        elapsed = (fix.stamp_ns - since.stamp_ns) * 1e-9
        drift = self._drift(1.0, (0.0, math.hypot(told.x, told.y)), (0.0, elapsed))
        spread = since.covariance + fix.covariance + drift
        done = self.odometry_check.compare(
            told, since.pose.inverse() @ fix.pose,
            sigma_xy=math.sqrt(spread[0, 0] + spread[1, 1]),
            sigma_yaw=math.sqrt(spread[2, 2]), elapsed=elapsed,
        )
        if done:
            self.known = replace(self.known, compared_since=fix)
