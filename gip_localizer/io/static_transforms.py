# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The tree of frames from /tf_static and /tf, and the pose of a camera in it."""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.extrinsics import Extrinsics, OPTICAL_FROM_BODY
from gip_localizer.errors import GipError

UNIT_SLACK = 1e-3
"""Largest deviation (no unit) of a quaternion's length from 1; chosen above rounding."""
LONGEST_CHAIN = 100
"""Largest number of frames between two frames; chosen, so that a loop of parents ends."""


class TransformError(GipError):
    """The frames are not connected, or a transform is invalid."""


class StaticTransforms:
    """Parent of each frame and the pose in it, from the newest messages."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}
        self._faults: dict[str, str] = {}

    def take(self, transforms: Iterable[Any]) -> None:
        """
        Take geometry_msgs/TransformStamped messages.

        An invalid one (NaN, no unit quaternion) is ignored, as in tf2. It is named in the error
        for unconnected frames, until a valid one of the same frame is received.

        """
        for message in transforms:
            parent, child = message.header.frame_id.lstrip('/'), message.child_frame_id.lstrip('/')
            try:
                self._parents[child] = (parent, _matrix(message.transform))
            except TransformError as error:
                self._faults[child] = f'{parent} to {child} was ignored: {error}'
            else:
                self._faults.pop(child, None)

    def extrinsics(self, base: str, optical: str) -> Extrinsics:
        """
        Return the pose of a camera in the vehicle.

        Parameters
        ----------
        base : str
            Frame of the vehicle.
        optical : str
            Optical frame of the camera: z forward, x right, y down.

        Raises
        ------
        TransformError
            The frames are not connected.

        """
        shared, to_base, to_camera = self._branches(base.lstrip('/'), optical.lstrip('/'))
        if shared is None:
            raise TransformError(self._unconnected(base, optical))
        pose = np.linalg.inv(self._along(to_base)) @ self._along(to_camera)
        R = pose[:3, :3] @ OPTICAL_FROM_BODY
        roll, pitch = math.atan2(R[2, 1], R[2, 2]), -math.asin(np.clip(R[2, 0], -1.0, 1.0))
        x, y, z = (float(value) for value in pose[:3, 3])
        return Extrinsics(x, y, z, roll, pitch, math.atan2(R[1, 0], R[0, 0]))

    def _branches(self, first: str, second: str) -> tuple[str | None, list[str], list[str]]:
        """Return the nearest common parent (or None), and the frames between it and each."""
        one, other = self._chain(first), self._chain(second)
        shared = next((frame for frame in one if frame in other), None)
        if shared is None:
            return None, one, other
        return shared, one[:one.index(shared)], other[:other.index(shared)]

    def _along(self, frames: list[str]) -> Floats:
        """Return the pose of the first frame in the parent of the last one."""
        matrix = np.eye(4)
        for frame in frames:
            matrix = self._parents[frame][1] @ matrix
        return matrix

    def _chain(self, frame: str) -> list[str]:
        """Return a frame, its parent and so on up to the root."""
        chain = [frame]
        while chain[-1] in self._parents and len(chain) < LONGEST_CHAIN:
            chain.append(self._parents[chain[-1]][0])
        return chain

    def _unconnected(self, base: str, optical: str) -> str:
        known = ', '.join(sorted(self._parents)) or 'none'
        return '; '.join([
            f'no transform connects {base!r} and {optical!r}; known frames: {known}',
            *self._faults.values(),
        ])


def _matrix(transform: Any) -> Floats:
    """Return a geometry_msgs/Transform as (4, 4)."""
    q, t = transform.rotation, transform.translation
    numbers = np.array([q.x, q.y, q.z, q.w, t.x, t.y, t.z], float)
    if not np.isfinite(numbers).all():
        raise TransformError('holds NaN or infinity')
    length = float(np.linalg.norm(numbers[:4]))
    if abs(length - 1.0) > UNIT_SLACK:
        raise TransformError(f'its quaternion has length {length:g}, expected 1')
    x, y, z, w = numbers[:4] / length
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = numbers[4:]
    return matrix
