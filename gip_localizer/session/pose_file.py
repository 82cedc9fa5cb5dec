# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The last pose in a file, so that tracking continues after a restart.

A file that is damaged, too old, of another map or of another frame is refused with the reason. The
restored pose is only a prior: poses are published after a frame has confirmed it.

"""

from __future__ import annotations

from dataclasses import asdict, dataclass
import hashlib
import json
import math
import os
from pathlib import Path
import tempfile

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief, checked_prior
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import GipError
from gip_localizer.parameters import Motion

FORMAT = 1
"""Version of the file format (no unit)."""
MAX_BYTES = 10_000
"""Most bytes of a state file that are read; chosen: a valid file has about 500."""
DISTANCE_ERROR = 0.5
"""Relative error (no unit) of a distance predicted from the last speed; chosen."""
TURN_RATE = 0.05
"""Error of the heading (rad/m) without odometry; chosen: that of a curve of 20 m radius."""
LEAST_DRIFT, LEAST_TURN = 0.1, 0.01
"""Least error (m, rad) of the motion from odometry between two runs; chosen."""


class StateError(GipError):
    """The state file cannot be used."""


@dataclass(frozen=True)
class LastPose:
    """
    Content of the file.

    Attributes
    ----------
    map_hash, frame : str
        Hash of the map, and frame of the pose.
    saved_at : float
        Seconds of the system clock.
    pose : (3,) floats
        x, y (m), yaw (rad) of the base in the map.
    covariance : (9,) floats
        Row by row, map axes.
    speed : float
        m/s along the vehicle.
    odometry : (3,) floats or None
        Pose of the base in odom at the same time.

    """

    map_hash: str
    frame: str
    saved_at: float
    pose: tuple[float, ...]
    covariance: tuple[float, ...]
    speed: float = 0.0
    odometry: tuple[float, ...] | None = None
    format: int = FORMAT

    def prior(self, now: float, motion: Motion, odometry: Pose2 | None) -> Belief:
        """
        Return the predicted pose of the vehicle now, with its uncertainty.

        Parameters
        ----------
        now : float
            Seconds of the system's clock.
        motion : Motion
            Noise of the odometry.
        odometry : Pose2 or None
            Base in odom now; None: constant speed is assumed.

        """
        age = max(now - self.saved_at, 0.0)
        covariance: Floats = np.reshape(self.covariance, (3, 3))
        driven = Pose2(self.speed * age, 0.0, 0.0)
        drift = DISTANCE_ERROR * abs(self.speed) * age + motion.sigma_xy_per_s * age
        turn = TURN_RATE * abs(self.speed) * age + motion.sigma_yaw_per_s * age
        if odometry is not None and self.odometry is not None:
            driven = Pose2(*self.odometry).inverse() @ odometry
            length = math.hypot(driven.x, driven.y)
            if length <= motion.max_speed * max(age, 1.0):
                drift = LEAST_DRIFT + motion.sigma_xy_per_m * length
                turn = LEAST_TURN + motion.sigma_yaw_per_m * length
        grown = covariance + np.diag([drift**2, drift**2, min(turn, math.pi) ** 2])
        return checked_prior(0, Pose2(*self.pose) @ driven, grown)


def map_hash(raster_map: RasterMap) -> str:
    """Return 16 hex digits that identify a map: a hash of cells, resolution and origin."""
    digest = hashlib.sha256(repr((
        raster_map.grey.shape, str(raster_map.grey.dtype), float(raster_map.resolution),
        tuple(float(value) for value in raster_map.origin),
    )).encode())
    digest.update(np.ascontiguousarray(raster_map.grey).tobytes())
    if raster_map.valid is not None:
        digest.update(np.packbits(raster_map.valid).tobytes())
    return digest.hexdigest()[:16]


def save_state(path: Path, state: LastPose) -> None:
    """
    Write a state file atomically: a reader finds the complete old or new file.

    Raises
    ------
    StateError
        The folder cannot be written to.

    """
    part: str | None = None
    try:
        handle, part = tempfile.mkstemp(prefix=f'.{path.name}.', dir=path.parent)
        with os.fdopen(handle, 'w', encoding='utf-8') as file:
            json.dump(asdict(state), file)
            file.flush()
            os.fsync(file.fileno())
        Path(part).replace(path)
    except OSError as error:
        if part is not None:
            Path(part).unlink(missing_ok=True)
        raise StateError(f'state_file {path}: cannot be written, {error}') from None


def load_state(path: Path, *, expected_hash: str, frame: str, now: float,
               max_age: float) -> LastPose:
    """
    Read a state file and check it.

    Raises
    ------
    StateError
        The file is missing, damaged, of another map or frame, too old, or from the future.

    """
    state = _read(path)
    age = now - state.saved_at
    if state.map_hash != expected_hash:
        raise StateError(f'state_file {path}: is of another map ({state.map_hash}, '
                         f'this one is {expected_hash}); not used')
    if state.frame != frame:
        raise StateError(f'state_file {path}: is in frame {state.frame!r}, not {frame!r}; '
                         'not used')
    if not -1.0 <= age <= max_age:
        raise StateError(f'state_file {path}: is {age:.0f} s old, expected 0 to {max_age:g} s '
                         '(state.max_age); not used')
    return state


def _read(path: Path) -> LastPose:
    try:
        with path.open('rb') as file:
            content = json.loads(file.read(MAX_BYTES).decode('utf-8'))
        if not isinstance(content, dict) or content.get('format') != FORMAT:
            raise ValueError(f'expected an object of format {FORMAT}')
        state = LastPose(**content)
        numbers = [state.saved_at, state.speed, *state.pose, *state.covariance,
                   *(state.odometry or (0.0, 0.0, 0.0))]
        if len(numbers) != 17 or not all(_is_finite(value) for value in numbers):
            raise ValueError('expected finite numbers: a pose of 3, a covariance of 9')
        checked_prior(0, Pose2(*state.pose), np.reshape(state.covariance, (3, 3)))
    except (
        OSError, ValueError, TypeError, OverflowError, RecursionError, GipError
    ) as error:
        raise StateError(f'state_file {path}: {error}; not used') from None
    return state


def _is_finite(value: object) -> bool:
    return type(value) in (int, float) and math.isfinite(value)  # type: ignore[arg-type]
