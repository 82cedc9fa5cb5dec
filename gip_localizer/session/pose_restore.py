# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Writes the last pose to its file now and then, and gives it back after a restart."""

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

WAITED_NS = 1_000_000_000
"""How long the first frames wait for odometry, by their stamps."""
SPEED_STEP = 2.0
"""Longest time (s) between two poses that still tell a speed."""

PARKED_XY, PARKED_YAW = 0.05, 0.01
"""Metres and radians that a parked vehicle's poses stay within (chosen: some cells' jitter)."""
PARKED_SHARE = 0.25
"""Of `state.max_age`, between two writings while parked: the file never grows too old."""


class StateKeeper:
    """
    Keeps the last pose of a localizer in `state_file`; does nothing where none is set.

    Parameters
    ----------
    localizer : Localizer
        Whose pose is kept, and who is given the prior.
    tell : callable
        Told what is wrong with the file.
    wall : callable
        Seconds of the system's clock: it goes on while the node is down.

    """

    def __init__(
        self, localizer: Localizer, tell: Callable[[str], object],
        wall: Callable[[], float] = time.time,
    ) -> None:
        parameters = localizer.parameters
        self._localizer = localizer
        self._tell = tell
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
            self._tell(str(error))
            return None

    def forget(self) -> None:
        """Drop what was restored: a better prior has come."""
        self._restored = None

    def before(self, stamp_ns: int) -> None:
        """Give the restored pose to the localizer, once the odometry is there or late."""
        state = self._restored
        if state is None:
            return
        if self._waiting_since is None:
            self._waiting_since = stamp_ns
        odometry = self._odometry(stamp_ns)
        waited = not 0 <= stamp_ns - self._waiting_since < WAITED_NS
        if odometry is None and state.odometry is not None and not waited:
            return
        self._restored = None
        try:
            belief = state.prior(self._wall(), self._localizer.parameters.motion, odometry)
        except GipError as error:  # the vehicle may be anywhere by now
            self._tell(f'state_file {self._path}: {error}; not used')
        else:
            self._localizer.set_prior(0, belief.pose, belief.covariance)

    def after(self, estimate: Estimate) -> None:
        """Write a published pose, unless the last one was written just now."""
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
            self._tell(str(error))

    def _period(self, pose: Pose2) -> float:
        """Return how long a written pose serves: longer while the vehicle is parked."""
        state = self._localizer.parameters.state
        moved = self._kept is None or max(
            math.hypot(pose.x - self._kept.x, pose.y - self._kept.y) / PARKED_XY,
            abs(wrap_angle(pose.yaw - self._kept.yaw)) / PARKED_YAW,
        ) > 1.0
        return state.period if moved else max(state.period, PARKED_SHARE * state.max_age)

    def _learn_speed(self, stamp_ns: int, pose: Pose2) -> None:
        if self._last is not None:
            elapsed = (stamp_ns - self._last[0]) * 1e-9
            if 0.0 < elapsed < SPEED_STEP:
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
