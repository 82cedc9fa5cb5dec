# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Data that are precomputed once per calibration and set of parameters."""

from __future__ import annotations

from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.birdseye.view_choice import complete_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.errors import CalibrationError, ParameterError
from gip_localizer.parameters import Birdseye, Parameters


class CalibratedView:
    """
    Rectifier and refiner of a camera.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera.
    parameters : Parameters
        All tunables.
    map_resolution : float
        Side of a cell of the map, metres, for a view that is chosen.

    Attributes
    ----------
    birdseye : Birdseye
        The view, with its chosen values.
    rectifier, refiner : Rectifier, Refiner
        For this view.

    Raises
    ------
    CalibrationError
        The camera sees no road in the view, or the search window needs too many candidates on the
        chosen cells.

    """

    def __init__(
        self, camera: CameraModel, parameters: Parameters, map_resolution: float
    ) -> None:
        self._inputs = _relevant(camera, parameters)
        self.birdseye = complete_view(parameters.birdseye, camera, map_resolution)
        _check(parameters, self.birdseye)
        self.rectifier = Rectifier(camera, self.birdseye)
        self.refiner = Refiner(
            self.rectifier, parameters.camera_motion,
            normalized=parameters.score.normalized,
            robust=parameters.score.robust,
            sigma_yaw=parameters.camera.sigma_yaw,
        )

    def matches(self, camera: CameraModel, parameters: Parameters) -> bool:
        """Return whether this was computed for the same calibration and parameters."""
        return self._inputs == _relevant(camera, parameters)


def _check(parameters: Parameters, view: Birdseye) -> None:
    """Check the parameters again with the chosen values of the view."""
    try:
        parameters.replace({f'birdseye.{name}': value for name, value in vars(view).items()})
    except ParameterError as error:
        raise CalibrationError(
            f'view {view.near:g} to {view.far:g} m ahead, cells of {view.resolution:g} m: {error}'
        ) from None


def _relevant(camera: CameraModel, parameters: Parameters) -> tuple[object, ...]:
    score = parameters.score
    return (
        camera.key(), parameters.birdseye, parameters.camera_motion, parameters.camera.sigma_yaw,
        score.metric, score.robust,
    )
