# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Saves the last pose to `state_file` periodically, and restores it after a restart."""

from __future__ import annotations

from collections.abc import Callable
import math
import os
import time

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.errors import GipError
from gip_localizer.parameters import Parameters
from gip_localizer.parameters.yaml_files import user_path
from gip_localizer.session.pose_file import LastPose, load_state, map_hash, save_state, StateError

ODOMETRY_WAIT_NS = 1_000_000_000
"""Longest time (ns, by stamps) that the restored pose waits for odometry; chosen."""
LONGEST_STEP = 2.0
"""Longest time (s) between two poses for estimating the speed; chosen."""

PARKED_XY, PARKED_YAW = 0.05, 0.01
"""Motion (m, rad) below which the vehicle counts as parked; chosen: noise of about one cell."""
PARKED_SHARE = 0.25
"""Period of writing while parked, as a share (no unit) of `state.max_age`; chosen below 1."""


class StateKeeper:
    """
    Saves and restores the last pose of a localizer; without `state_file` it does nothing.

    Parameters
    ----------
    localizer : Localizer
        The localizer that gets the restored pose as its prior.
    warn : callable
        Takes error messages about the file.
    wall : callable
        Seconds of the system clock, which also runs while the node does not.

    """

    def __init__(
        self, localizer: Localizer, warn: Callable[[str], object],
        wall: Callable[[], float] = time.time,
    ) -> None:
        parameters = localizer.parameters
        self._localizer = localizer
        self._warn = warn
        self._wall = wall
        self._path = user_path(parameters.state_file) if parameters.state_file else None
        self._written = float('-inf')
        self._kept: Pose2 | None = None
        self._speed = 0.0
        self._last: tuple[int, Pose2] | None = None
        self._waiting_since: int | None = None
        self._hash = map_hash(localizer.raster_map) if self._path is not None else ''
        self._restored = self._load()

    def _load(self) -> LastPose | None:
        if self._path is None or not os.path.exists(self._path):  # noqa: PTH110 - never raises
            return None
        parameters = self._localizer.parameters
        try:
            return load_state(
                self._path, expected_hash=self._hash, frame=parameters.frames.map,
                now=self._wall(), max_age=parameters.state.max_age,
            )
        except StateError as error:
            self._warn(str(error))
            return None

    def forget(self) -> None:
        """Discard the restored pose, because there is a newer prior."""
        self._restored = None

    def before(self, stamp_ns: int) -> None:
        """Pass the restored pose to the localizer as soon as odometry is there or overdue."""
        state = self._restored
        if state is None:
            return
        if self._waiting_since is None:
            self._waiting_since = stamp_ns
        odometry = self._odometry(stamp_ns)
        waited = not 0 <= stamp_ns - self._waiting_since < ODOMETRY_WAIT_NS
        if odometry is None and state.odometry is not None and not waited:
            return
        self._restored = None
        try:
            belief = state.prior(self._wall(), self._localizer.parameters.motion, odometry)
        except GipError as error:  # the covariance has grown too large
            self._warn(f'state_file {self._path}: {error}; not used')
        else:
            self._localizer.set_prior(0, belief.pose, belief.covariance)

    def after(self, estimate: Estimate) -> None:
        """Save a published pose if the period since the last writing is over."""
        if self._path is None or estimate.pose is None or estimate.covariance is None:
            return
        self._learn_speed(estimate.stamp_ns, estimate.pose)
        now, parameters = self._wall(), self._localizer.parameters
        if 0.0 <= now - self._written < self._period(estimate.pose):
            return
        self._kept = estimate.pose
        self._written = now
        odometry = self._odometry(estimate.stamp_ns)
        try:
            save_state(self._path, _state(self._hash, parameters, now, estimate, self._speed,
                                          odometry))
        except StateError as error:
            self._warn(str(error))

    def _period(self, pose: Pose2) -> float:
        """Return the time (s) until the next writing, which is longer while parked."""
        state = self._localizer.parameters.state
        moved = self._kept is None or max(
            math.hypot(pose.x - self._kept.x, pose.y - self._kept.y) / PARKED_XY,
            abs(wrap_angle(pose.yaw - self._kept.yaw)) / PARKED_YAW,
        ) > 1.0
        return state.period if moved else max(state.period, PARKED_SHARE * state.max_age)

    def _learn_speed(self, stamp_ns: int, pose: Pose2) -> None:
        if self._last is not None:
            elapsed = (stamp_ns - self._last[0]) * 1e-9
            if 0.0 < elapsed < LONGEST_STEP:
                self._speed = (self._last[1].inverse() @ pose).x / elapsed
        self._last = (stamp_ns, pose)

    def _odometry(self, stamp_ns: int) -> Pose2 | None:
        return self._localizer.state.pose_filter.odometry.pose_at(stamp_ns)


def _state(
    fingerprint: str, parameters: Parameters, now: float, estimate: Estimate, speed: float,
    odometry: Pose2 | None,
) -> LastPose:
    assert estimate.pose is not None
    assert estimate.covariance is not None
    return LastPose(
        fingerprint, parameters.frames.map, now,
        tuple(float(value) for value in estimate.pose),
        tuple(float(value) for value in estimate.covariance.ravel()),
        speed, None if odometry is None else tuple(float(value) for value in odometry),
    )  # fmt: skip
