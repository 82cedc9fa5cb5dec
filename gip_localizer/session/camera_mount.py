# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`camera.from_tf`: the camera's pose in the vehicle, from /tf_static and /tf."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math
from typing import Any

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.errors import ParameterError
from gip_localizer.io.static_transforms import StaticTransforms, TransformError
from gip_localizer.parameters import Parameters

MOVED = 1e-6
"""Least change (m, rad) that is a new pose of the camera; smaller ones are rounding; chosen."""


class CameraMount:
    """
    Looks up the camera's pose in the vehicle, over any number of frames in between.

    The newest of a changing transform is used: a mount moves little between two images.

    Parameters
    ----------
    base : str
        Frame of the vehicle.
    place : callable
        Takes each new pose of the camera; raises ParameterError if the pose is impossible.
    report : callable
        Takes a description of each new pose, for the log.

    Attributes
    ----------
    fault : str
        Why the camera's pose is not known; empty if it is.
    extrinsics : Extrinsics or None
        Pose of the camera in the vehicle; None until it is known.

    """

    def __init__(
        self, base: str, place: Callable[[Extrinsics], None], report: Callable[[str], object]
    ) -> None:
        self.fault = 'no image or camera_info has been received, so the camera frame is unknown'
        self._base, self._place, self._report = base, place, report
        self._tree = StaticTransforms()
        self._optical: str | None = None
        self._stale = False
        self.extrinsics: Extrinsics | None = None

    def take(self, transforms: Iterable[Any]) -> None:
        """Take geometry_msgs/TransformStamped messages; they apply from the next image on."""
        self._tree.take(transforms)
        self._stale = True
        if self.extrinsics is None:
            self._look_up()

    def take_frame_id(self, frame: str) -> None:
        """Take the frame_id of an image or a camera_info, and look the camera up if needed."""
        if frame != self._optical:
            self._optical, self.extrinsics, self._stale = frame, None, True
        if self._stale:
            self._look_up()

    def _look_up(self) -> None:
        if self._optical is None:
            return
        self._stale = False
        try:
            extrinsics = self._tree.extrinsics(self._base, self._optical)
        except TransformError as error:
            if self.extrinsics is None:
                self.fault = str(error)
            return
        if self.extrinsics is not None and not _moved(self.extrinsics, extrinsics):
            return
        try:
            self._place(extrinsics)
        except ParameterError as error:
            self.extrinsics = None
            self.fault = f'{self._base!r} to {self._optical!r}: {error}'
            return
        self.extrinsics, self.fault = extrinsics, ''
        self._report(', '.join(f'{name} {value:.4g}' for name, value in vars(extrinsics).items()))


def with_camera(parameters: Parameters, extrinsics: Extrinsics | None) -> Parameters:
    """Return the parameters with the camera pose from TF (raises ParameterError)."""
    if extrinsics is None:
        return parameters
    return parameters.replace(
        {f'camera.{name}': value for name, value in vars(extrinsics).items()}
    )


def _moved(before: Extrinsics, now: Extrinsics) -> bool:
    pairs = zip(vars(before).values(), vars(now).values(), strict=True)
    return any(not math.isclose(a, b, rel_tol=0.0, abs_tol=MOVED) for a, b in pairs)
