# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Data that are precomputed once per calibration and set of parameters."""

from __future__ import annotations

from functools import partial
import time

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.birdseye.view_choice import complete_view, fitting_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.accuracy import EXACT, MapAccuracy
from gip_localizer.core.refine.covariance_parts import mount_covariance
from gip_localizer.core.refine.refiner import Refiner
from gip_localizer.errors import CalibrationError, ParameterError
from gip_localizer.parameters import Birdseye, Parameters

LEAST_INSIDE = 0.05
"""Least share of the cells of a view inside the image; chosen: with fewer a match is luck."""


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
    map_accuracy : MapAccuracy
        As the map states it; `map.sigma_xy` and `.sigma_yaw` may say more.

    Attributes
    ----------
    birdseye : Birdseye
        The view, with its chosen values.
    rectifier, refiner : Rectifier, Refiner
        For this view.
    seconds : float
        Time that the computation took.

    Raises
    ------
    CalibrationError
        The camera sees no road in the view, or the search window needs too many candidates on the
        chosen cells.

    """

    def __init__(
        self, camera: CameraModel, parameters: Parameters, map_resolution: float,
        map_accuracy: MapAccuracy = EXACT,
    ) -> None:
        started = time.perf_counter()
        self._inputs = _relevant(camera, parameters, map_resolution, map_accuracy)
        self.birdseye = complete_view(parameters.birdseye, camera, map_resolution)
        _check(parameters, self.birdseye)
        self.rectifier = _rectifier(camera, self.birdseye, map_resolution)
        self._make_refiner = partial(
            Refiner, self.rectifier, parameters.camera_motion,
            normalized=parameters.score.normalized,
            robust=parameters.score.robust,
            constant_errors=_constant_errors(camera, parameters, map_accuracy),
        )
        self.refiner = self._make_refiner()
        self.seconds = time.perf_counter() - started

    def renew_refiner(self) -> None:
        """Compute the refiner again, after a constant of refinement was changed."""
        self.refiner = self._make_refiner()

    def matches(
        self, camera: CameraModel, parameters: Parameters, map_resolution: float,
        map_accuracy: MapAccuracy = EXACT,
    ) -> bool:
        """Return whether this was computed for the same calibration, parameters and map."""
        return self._inputs == _relevant(camera, parameters, map_resolution, map_accuracy)


def _rectifier(camera: CameraModel, view: Birdseye, map_resolution: float) -> Rectifier:
    """Return the rectifier of a view that lies inside the image (raises CalibrationError)."""
    try:
        rectifier = Rectifier(camera, view)
    except CalibrationError as error:
        raise CalibrationError(f'{error}; {fitting_view(camera, map_resolution)}') from None
    inside = float(rectifier.valid.mean())
    if inside < LEAST_INSIDE:
        raise CalibrationError(
            f'{100.0 * (1.0 - inside):.0f} % of the cells of the view lie outside the image; '
            f'{fitting_view(camera, map_resolution)}'
        )
    return rectifier


def _check(parameters: Parameters, view: Birdseye) -> None:
    """Check the parameters again with the chosen values of the view."""
    try:
        parameters.replace({f'birdseye.{name}': value for name, value in vars(view).items()})
    except ParameterError as error:
        raise CalibrationError(
            f'view {view.near:g} to {view.far:g} m ahead, cells of {view.resolution:g} m: {error}'
        ) from None


def _constant_errors(
    camera: CameraModel, parameters: Parameters, map_accuracy: MapAccuracy
) -> Floats:
    """Return the covariance (3, 3) from the errors of mounting yaw and map."""
    stated = map_accuracy.at_least(MapAccuracy(parameters.map.sigma_xy, parameters.map.sigma_yaw))
    mount = mount_covariance(camera.extrinsics.position(), parameters.camera.sigma_yaw)
    return mount + stated.covariance()


def _relevant(
    camera: CameraModel, parameters: Parameters, *of_map: object
) -> tuple[object, ...]:
    score = parameters.score
    return (
        camera.key(), parameters.birdseye, parameters.camera_motion, parameters.camera.sigma_yaw,
        parameters.map, score.metric, score.robust, *of_map,
    )
