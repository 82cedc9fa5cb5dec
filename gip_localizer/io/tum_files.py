# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
TUM files of trajectories.

A line is `stamp x y z qx qy qz qw`: seconds, metres, a unit quaternion. Stamps are read and
written as decimal text, so that nanoseconds are kept exactly.

"""

from __future__ import annotations

from decimal import Decimal, InvalidOperation
import math
from pathlib import Path

import numpy as np

from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.errors import OutputError, TrajectoryError
from gip_localizer.io.trajectory import stamp_text, Trajectory
from gip_localizer.parameters.yaml_files import user_path

STEEPEST = 0.7
"""Largest roll or pitch (rad); chosen: the steepest street has 0.34, banked tracks 0.6."""
LATEST = 9_000_000_000
"""Largest stamp (s), in the year 2255; chosen: larger ones have another unit."""
UNITS = {'nanoseconds': 10**18, 'microseconds': 10**15, 'milliseconds': 10**12}
"""Unit → order of magnitude of today's time in it."""


def write_tum(path: Path | str, trajectory: Trajectory) -> None:
    """Write a TUM file (evo reads it); raise OutputError if it cannot be written."""
    lines = [
        f'{stamp_text(int(stamp))} {x:.12f} {y:.12f} 0 0 0 '
        f'{math.sin(yaw / 2.0):.17g} {math.cos(yaw / 2.0):.17g}\n'
        for stamp, (x, y, yaw) in zip(trajectory.stamps_ns, trajectory.poses, strict=True)
    ]
    try:
        Path(path).write_text(''.join(lines), encoding='utf-8')
    except OSError as error:
        raise OutputError(f'cannot write {path}: {error.strerror}') from None


def read_tum(path: Path | str) -> Trajectory:
    """
    Read a TUM file.

    Comments (#), empty lines and a byte order mark are skipped. Roll and pitch are dropped.

    Raises
    ------
    TrajectoryError
        Unreadable, empty, or a line that is not eight finite numbers with growing stamps and a
        unit quaternion, or a roll or pitch beyond any road; the message names file and line.

    """
    try:
        text = user_path(path).read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f'{path}: cannot be read as a TUM text file: {error}') from None
    stamps: list[int] = []
    poses: list[Pose2] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith('#'):
            continue
        where = f'{path}:{number}'
        stamp, pose = _parse(line, where)
        if stamps and stamp <= stamps[-1]:
            raise TrajectoryError(
                f'{where}: stamp {stamp_text(stamp)} is not after {stamp_text(stamps[-1])}; '
                'sort the file by time and drop repeated lines'
            )
        stamps.append(stamp)
        poses.append(pose)
    if not stamps:
        raise TrajectoryError(f'{path}: holds no pose; expected lines "stamp x y z qx qy qz qw"')
    return Trajectory(np.array(stamps, np.int64), np.array(poses, np.float64))


def _parse(line: str, where: str) -> tuple[int, Pose2]:
    stamp, (x, y, _, *quaternion) = tum_numbers(line, where)
    if max(map(abs, roll_and_pitch(*quaternion))) > STEEPEST:
        raise TrajectoryError(_too_steep(where, quaternion))
    return stamp, Pose2(x, y, _yaw(*quaternion))


def tum_numbers(line: str, where: str) -> tuple[int, list[float]]:
    """
    Return stamp (ns) and x, y, z (m), qx, qy, qz, qw of a TUM line.

    Raises
    ------
    TrajectoryError
        Not eight finite numbers with a unit quaternion; the message begins with `where`.

    """
    words = line.split()
    if len(words) != 8:
        raise TrajectoryError(
            f'{where}: {len(words)} columns, expected 8 "stamp x y z qx qy qz qw" '
            'separated by spaces'
        )
    try:
        stamp = Decimal(words[0])
        numbers = [float(word) for word in words[1:]]
    except (InvalidOperation, ValueError):
        raise TrajectoryError(f'{where}: not eight numbers: {line.strip()[:80]!r}') from None
    norm = math.hypot(*numbers[3:])
    if not (stamp.is_finite() and all(map(math.isfinite, (*numbers[:3], norm)))):
        raise TrajectoryError(f'{where}: a number is not finite: {line.strip()[:80]!r}')
    if abs(stamp) > LATEST:
        raise TrajectoryError(_other_unit(where, stamp))
    if abs(norm - 1.0) > 1e-2:
        raise TrajectoryError(
            f'{where}: quaternion of length {norm:.4g} (expected 1), stamp {stamp} s'
        )
    return int((stamp * 1_000_000_000).to_integral_value()), numbers


def _other_unit(where: str, stamp: Decimal) -> str:
    """Return the error for a stamp that is no time in seconds, with its likely unit."""
    unit = next((unit for unit, least in UNITS.items() if abs(stamp) >= least), None)
    suspicion = f'stamps look like {unit}' if unit else 'it is not a time in seconds'
    return f'{where}: stamp {str(stamp)[:40]}: {suspicion}; expected seconds'


def _too_steep(where: str, quaternion: list[float]) -> str:
    """Return the error for a pose that is too steep, with the likely mistake in its columns."""
    roll, pitch = roll_and_pitch(*quaternion)
    w, x, y, z = quaternion
    first = max(map(abs, roll_and_pitch(x, y, z, w))) <= STEEPEST
    return (
        f'{where}: roll {math.degrees(roll):.0f} and pitch {math.degrees(pitch):.0f} degrees are '
        'beyond any road; '
        + ('is it "qw qx qy qz", w first?' if first else 'is it the pose of base_link?')
        + ' Expected "stamp x y z qx qy qz qw" of a frame whose z is up'
    )


def roll_and_pitch(qx: float, qy: float, qz: float, qw: float) -> tuple[float, float]:
    """Return roll and pitch, rad, of a quaternion of any length but 0 (REP 103)."""
    norm = qx * qx + qy * qy + qz * qz + qw * qw
    roll = math.atan2(2.0 * (qw * qx + qy * qz), norm - 2.0 * (qx * qx + qy * qy))
    sin = 2.0 * (qw * qy - qz * qx) / norm
    return roll, math.asin(min(max(sin, -1.0), 1.0))


def _yaw(qx: float, qy: float, qz: float, qw: float) -> float:
    norm = qx * qx + qy * qy + qz * qz + qw * qw
    sin, cos = 2.0 * (qw * qz + qx * qy), norm - 2.0 * (qy * qy + qz * qz)
    return wrap_angle(math.atan2(sin, cos))
