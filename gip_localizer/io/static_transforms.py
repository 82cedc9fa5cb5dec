# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The static part of the tree of frames, as /tf_static tells it, and a camera's place in it."""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.model import Extrinsics, OPTICAL_FROM_BODY
from gip_localizer.errors import GipError

UNIT_SLACK = 1e-3
LONGEST_CHAIN = 100


class TransformError(GipError):
    """The frames are not connected, or a transform is no transform."""


class StaticTransforms:
    """Parent of each frame, and the frame's pose in it."""

    def __init__(self) -> None:
        self._parents: dict[str, tuple[str, Floats]] = {}

    def take(self, transforms: Iterable[Any]) -> None:
        """
        Take geometry_msgs/TransformStamped messages.

        Raises
        ------
        TransformError
            One holds NaN or a quaternion that is not of unit length; the others are taken.

        """
        faults = []
        for message in transforms:
            parent, child = message.header.frame_id.lstrip('/'), message.child_frame_id.lstrip('/')
            try:
                self._parents[child] = (parent, _matrix(message.transform))
            except TransformError as error:
                faults.append(f'{parent} to {child}: {error}')
        if faults:
            raise TransformError('; '.join(faults))

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
            The frames are not connected by static transforms.

        """
        pose = np.linalg.inv(self._from_root(base, optical)) @ self._from_root(optical, base)
        R = pose[:3, :3] @ OPTICAL_FROM_BODY
        roll, pitch = math.atan2(R[2, 1], R[2, 2]), -math.asin(np.clip(R[2, 0], -1.0, 1.0))
        x, y, z = (float(value) for value in pose[:3, 3])
        return Extrinsics(x, y, z, roll, pitch, math.atan2(R[1, 0], R[0, 0]))

    def _from_root(self, frame: str, other: str) -> Floats:
        """Return the pose of a frame in the root of the tree that holds both."""
        chain, matrix = [frame.lstrip('/')], np.eye(4)
        while chain[-1] in self._parents and len(chain) < LONGEST_CHAIN:
            parent, step = self._parents[chain[-1]]
            chain.append(parent)
            matrix = step @ matrix
        if not set(chain) & set(self._chain(other)):
            raise TransformError(
                f'no static transform connects {frame!r} and {other!r}; '
                f'known frames: {", ".join(sorted(self._parents)) or "none"}'
            )
        return matrix

    def _chain(self, frame: str) -> list[str]:
        chain = [frame.lstrip('/')]
        while chain[-1] in self._parents and len(chain) < LONGEST_CHAIN:
            chain.append(self._parents[chain[-1]][0])
        return chain


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
