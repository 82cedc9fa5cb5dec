# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`camera.from_tf`: the camera's pose in the vehicle, as /tf_static and /tf have it."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import math
from typing import Any

from gip_localizer.core.camera.model import Extrinsics
from gip_localizer.errors import ParameterError
from gip_localizer.io.static_transforms import StaticTransforms, TransformError
from gip_localizer.parameters import Parameters

MOVED = 1e-6
"""Metres, and radians, of a new place: less is rounding in the transforms of the same one."""


class CameraMount:
    """
    Follows the transforms from the vehicle to the camera, over any number of frames between.

    Of a transform that moves, the newest is taken: a mount turns little between two images.

    Parameters
    ----------
    base : str
        Frame of the vehicle.
    place : callable
        Takes each new place; raises ParameterError where no camera can be.
    report : callable
        Takes a new place in words.

    Attributes
    ----------
    fault : str
        Why the camera's pose is not known; empty where it is.
    known : Extrinsics or None
        The camera in the vehicle.

    """

    def __init__(
        self, base: str, place: Callable[[Extrinsics], None], report: Callable[[str], object]
    ) -> None:
        self.fault = 'no image or camera_info has named its frame yet'
        self._base, self._place, self._report = base, place, report
        self._tree = StaticTransforms()
        self._optical: str | None = None
        self._stale = False
        self.known: Extrinsics | None = None

    def take(self, transforms: Iterable[Any]) -> None:
        """Take geometry_msgs/TransformStamped messages; a known camera moves at the next image."""
        self._tree.take(transforms)
        self._stale = True
        if self.known is None:
            self._look_up()

    def seen_in(self, frame: str) -> None:
        """Take the frame that an image or a camera_info names."""
        if frame != self._optical:
            self._optical, self.known, self._stale = frame, None, True
        if self._stale:
            self._look_up()

    def _look_up(self) -> None:
        if self._optical is None:
            return
        self._stale = False
        try:
            extrinsics = self._tree.extrinsics(self._base, self._optical)
        except TransformError as error:
            if self.known is None:
                self.fault = str(error)
            return
        if self.known is not None and not _moved(self.known, extrinsics):
            return
        try:
            self._place(extrinsics)
        except ParameterError as error:
            self.known = None
            self.fault = f'{self._base!r} to {self._optical!r}: {error}'
            return
        self.known, self.fault = extrinsics, ''
        self._report(', '.join(f'{name} {value:.4g}' for name, value in vars(extrinsics).items()))


def placed(parameters: Parameters, extrinsics: Extrinsics | None) -> Parameters:
    """Return the parameters with the camera where TF has it (raises ParameterError)."""
    if extrinsics is None:
        return parameters
    return parameters.replace(
        {f'camera.{name}': value for name, value in vars(extrinsics).items()}
    )


def _moved(before: Extrinsics, now: Extrinsics) -> bool:
    pairs = zip(vars(before).values(), vars(now).values(), strict=True)
    return any(not math.isclose(a, b, rel_tol=0.0, abs_tol=MOVED) for a, b in pairs)
