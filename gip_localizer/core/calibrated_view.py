# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Data that are precomputed once per calibration and set of parameters."""

from __future__ import annotations

from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.parameters import Parameters


class CalibratedView:
    """
    Rectifier and refiner of a camera.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera.
    parameters : Parameters
        All tunables.

    Raises
    ------
    CalibrationError
        The camera sees no road in the view.

    """

    def __init__(self, camera: CameraModel, parameters: Parameters) -> None:
        self._inputs = _relevant(camera, parameters)
        self.rectifier = Rectifier(camera, parameters.birdseye)
        self.refiner = Refiner(
            self.rectifier, parameters.camera_motion,
            normalized=parameters.score.normalized,
            robust=parameters.score.robust,
            sigma_yaw=parameters.camera.sigma_yaw,
        )

    def matches(self, camera: CameraModel, parameters: Parameters) -> bool:
        """Return whether this was computed for the same calibration and parameters."""
        return self._inputs == _relevant(camera, parameters)


def _relevant(camera: CameraModel, parameters: Parameters) -> tuple[object, ...]:
    score = parameters.score
    return (
        camera.key(), parameters.birdseye, parameters.camera_motion, parameters.camera.sigma_yaw,
        score.metric, score.robust,
    )
