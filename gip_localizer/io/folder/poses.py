# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Poses of a drive in TUM or KITTI files → spatial poses of base_link in the map frame.

A TUM line is `stamp x y z qx qy qz qw`; a KITTI line holds the twelve numbers of [R | t] by rows,
one line per image. KITTI's are poses of the camera (z forward) in the frame of its first image:
the map frame is then base_link at that image.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import TrajectoryError
from gip_localizer.io.trajectory import MAX_GAP_NS, Trajectory
from gip_localizer.io.tum_files import STEEPEST, tum_numbers

Floats = NDArray[np.float64]
NAMES = ('poses.txt', 'groundtruth.txt', 'ground_truth.txt', 'poses.tum', 'ground_truth.tum')
TUM, KITTI = 8, 12
"""Number of columns of a line of the formats TUM and KITTI."""
BASE, CAMERA = 'base', 'camera'
ORTHONORMAL = 1e-2
"""Largest deviation of RᵀR from the identity (no unit) that is rounding; chosen."""
MOVED = 2.0
"""Distance, m, from which the path of a drive shows its direction; chosen."""
OFF_COURSE = 0.5
"""Angle, rad, between path and heading that no vehicle drives for long; chosen."""
FASTEST = 70.0
"""Speed, m/s, beyond which two poses in a row are a jump: default of `motion.max_speed`."""


@dataclass(frozen=True, eq=False)
class SpatialPoses:
    """
    Poses of base_link in the map frame.

    Attributes
    ----------
    stamps_ns : (n,) int64
        Strictly increasing, nanoseconds.
    T_map_base : (n, 4, 4) float64
        Metres.
    notes : list of str
        What was assumed, and gaps and jumps.

    """

    stamps_ns: NDArray[np.int64]
    T_map_base: Floats
    notes: list[str]

    @property
    def planar(self) -> Trajectory:
        """The same as x, y and yaw."""
        T = self.T_map_base
        yaw = np.arctan2(T[:, 1, 0], T[:, 0, 0])
        return Trajectory(self.stamps_ns, np.column_stack([T[:, 0, 3], T[:, 1, 3], yaw]))


def read_poses(
    path: Path, image_stamps: Sequence[int], held: Extrinsics, of: str | None = None
) -> SpatialPoses:
    """
    Read a file of poses.

    Parameters
    ----------
    path : Path
        TUM (eight columns) or KITTI (twelve).
    image_stamps : sequence of int
        Of all images, nanoseconds: the stamps of KITTI poses.
    held : Extrinsics
        Pose of the camera in the vehicle.
    of : str or None
        `base` or `camera` (optical frame, z forward): whose poses they are; None: those of base
        in TUM files, of the camera in KITTI files.

    Raises
    ------
    TrajectoryError
        Unreadable, of another form, not of a vehicle on a road, or without headings.

    """
    rows = _rows(path)
    columns = len(rows[0][1].split())
    if columns == TUM:
        stamps, poses = _tum(rows)
    elif columns == KITTI:
        stamps, poses = list(image_stamps), _kitti(path, rows, len(image_stamps))
    else:
        raise TrajectoryError(_other_form(rows[0][0], columns))
    of = of or (BASE if columns == TUM else CAMERA)
    T, notes = _of_base(path, poses, held, of)
    found = SpatialPoses(np.array(stamps, np.int64), T, [f'poses are taken from {path}', *notes])
    _check_heading(path, found)
    return SpatialPoses(found.stamps_ns, T, [*found.notes, *_interruptions(found, image_stamps)])


def _rows(path: Path) -> list[tuple[str, str]]:
    """Return place (file:line) and text of each line with numbers."""
    try:
        text = path.read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f'{path}: cannot be read as text: {error}') from None
    rows = [(f'{path}:{number}', line) for number, line in enumerate(text.splitlines(), start=1)
            if line.strip() and not line.lstrip().startswith('#')]
    if not rows:
        raise TrajectoryError(f'{path}: holds no poses; expected the lines of a TUM or KITTI file')
    return rows


def _other_form(where: str, columns: int) -> str:
    planar = {3: 'stamp x y, without heading', 4: 'stamp x y yaw'}
    hint = f' (in 2-D, {planar[columns]}?)' if columns in planar else ''
    return (
        f'{where}: {columns} columns{hint}; expected TUM lines "stamp x y z qx qy qz qw", in 2-D '
        'with z = 0 and the quaternion 0 0 sin(yaw/2) cos(yaw/2), or the 12 numbers of KITTI'
    )


def _tum(rows: Sequence[tuple[str, str]]) -> tuple[list[int], Floats]:
    stamps: list[int] = []
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for (where, line), pose in zip(rows, poses, strict=True):
        stamp, numbers = tum_numbers(line, where)
        if stamps and stamp <= stamps[-1]:
            raise TrajectoryError(f'{where}: its stamp is not after that of the line before; sort '
                                  'the file by time and drop repeated lines')
        stamps.append(stamp)
        pose[:3, 3] = numbers[:3]
        pose[:3, :3] = Rotation.from_quat(numbers[3:]).as_matrix()
    return stamps, poses


def _kitti(path: Path, rows: Sequence[tuple[str, str]], images: int) -> Floats:
    if len(rows) != images:
        raise TrajectoryError(f'{path} has {len(rows)} poses for {images} images; a KITTI file '
                              'has one line per image')
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    for (where, line), pose in zip(rows, poses, strict=True):
        try:
            numbers = np.array([float(word) for word in line.split()])
            pose[:3] = numbers.reshape(3, 4)
        except ValueError:
            raise TrajectoryError(f'{where}: not twelve numbers: {line.strip()[:80]!r}') from None
        R = pose[:3, :3]
        if not (np.isfinite(numbers).all() and np.abs(R.T @ R - np.eye(3)).max() < ORTHONORMAL):
            raise TrajectoryError(f'{where}: the numbers are no rotation with a translation; '
                                  'expected [R | t] by rows')
    return poses


def _of_base(
    path: Path, poses: Floats, held: Extrinsics, of: str
) -> tuple[Floats, list[str]]:
    """Return T_map_base; a world with the camera's axes becomes one whose z is up."""
    if of == BASE:
        if _upright(poses):
            return poses, []
        raise TrajectoryError(
            f'{path}: these are not poses of a vehicle on a road (roll or pitch beyond '
            f'{math.degrees(STEEPEST):.0f} degrees); if they are of the camera, give '
            '--poses-of camera'
        )
    T_base_camera = np.eye(4)
    T_base_camera[:3, :3], T_base_camera[:3, 3] = held.rotation(), held.position()
    T_camera_base = np.linalg.inv(T_base_camera)
    from_camera = poses @ T_camera_base
    if _upright(from_camera):
        return from_camera, ['they are poses of the camera in a frame whose z is up']
    from_first = T_base_camera @ from_camera
    if _upright(from_first):
        return from_first, ['they are poses of the camera in the frame of its first image: the '
                            'map frame is base_link at that image']
    raise TrajectoryError(
        f'{path}: with the camera as it is mounted, the vehicle would roll or pitch beyond '
        f'{math.degrees(STEEPEST):.0f} degrees; check --camera-pose, and --poses-of'
    )


def _upright(T: Floats) -> bool:
    """Return whether roll and pitch of every pose are possible on a road."""
    z = T[:, :3, 2]
    return bool(np.all(z[:, 2] > math.cos(STEEPEST)))


def _check_heading(path: Path, poses: SpatialPoses) -> None:
    """Refuse one heading for all poses that is not the direction of the path."""
    x, y, yaw = poses.planar.poses.T
    if np.ptp(yaw) > 1e-9 or len(yaw) < 2:
        return
    steps = np.hypot(np.diff(x), np.diff(y))
    if steps.sum() < MOVED:
        return
    moving = steps > 1e-3
    course = np.arctan2(np.diff(y)[moving], np.diff(x)[moving]) - yaw[0]
    apart = np.abs(np.angle(np.exp(1j * course)))
    apart = np.minimum(apart, math.pi - apart)  # backwards is a direction of driving too
    if np.median(apart) > OFF_COURSE or np.percentile(apart, 90.0) > OFF_COURSE:
        raise TrajectoryError(
            f'{path}: the poses hold no heading: it is {math.degrees(yaw[0]):.1f} degrees in all '
            f'of them, but the path leads up to {math.degrees(apart.max()):.0f} degrees elsewhere'
        )


def _interruptions(poses: SpatialPoses, image_stamps: Sequence[int]) -> list[str]:
    stamps, notes = poses.stamps_ns, []
    start = min(int(stamps[0]), image_stamps[0])
    for before, after in pairwise(stamps):
        if after - before > MAX_GAP_NS:
            notes.append(f'the poses have a gap from {(before - start) * 1e-9:.2f} to '
                         f'{(after - start) * 1e-9:.2f} s')
    moved = np.linalg.norm(np.diff(poses.T_map_base[:, :3, 3], axis=0), axis=1)
    for row in np.flatnonzero(moved > FASTEST * np.diff(stamps) * 1e-9):
        notes.append(f'the poses jump by {moved[row]:.1f} m at '
                     f'{(stamps[row + 1] - start) * 1e-9:.2f} s')
    known = np.isfinite(poses.planar.at(np.array(image_stamps))[:, 0])
    if not known.all():
        notes.append(f'{int((~known).sum())} of {len(known)} images have no pose: the poses cover '
                     f'{(stamps[0] - start) * 1e-9:.2f} to {(stamps[-1] - start) * 1e-9:.2f} s')
    if not known.any():
        notes.append('are the stamps of images and poses of one clock?')
    return notes


def start_pose(poses: SpatialPoses, image_stamps: Sequence[int]) -> Pose2 | None:
    """Return the pose at the first image; None if it is not known."""
    x, y, yaw = (float(value) for value in poses.planar.at(np.array(image_stamps[:1]))[0])
    return Pose2(x, y, yaw) if math.isfinite(x + y + yaw) else None
