# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a lens as drivers write them → as their model takes them."""

from __future__ import annotations

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.calibration import FISHEYE_MODELS, PINHOLE_MODELS
from gip_localizer.errors import CalibrationError

LENGTHS: dict[str, tuple[int, ...]] = {
    **PINHOLE_MODELS, **dict.fromkeys(FISHEYE_MODELS, (4,)),
    'rational_polynomial': (4, 5, *PINHOLE_MODELS['rational_polynomial']),
}
"""Model → allowed numbers of coefficients D (OpenCV, sensor_msgs/distortion_models)."""
PLUMB_BOB, RATIONAL = 'plumb_bob', 'rational_polynomial'


def lens(model: str, D: Floats) -> tuple[str, Floats]:
    """
    Return the distortion model and its numbers.

    Parameters
    ----------
    model : str
        As the CameraInfo names it; empty: the one model that takes so many numbers, as the Python
        image_geometry uses them (the one in C++ refuses).
    D : (n,) float64
        Zeros beyond what the model takes are left out.

    Returns
    -------
    model : str
        As named; plumb_bob where a rational model has no more numbers than that, and where a
        fisheye has zeros of another length: five zeros mean no distortion (as in image_geometry),
        and only four zeros an ideal fisheye.
    D : (m,) float64
        Of a length that the model takes, where there is one.

    Raises
    ------
    CalibrationError
        The model is not named, and no or more than one model takes so many numbers.

    """
    if not D.any():
        other = model in FISHEYE_MODELS and D.size not in (0, *LENGTHS[model])
        return (PLUMB_BOB if other else model), D
    if not model:
        return _only_model(D), D
    lengths = LENGTHS.get(model, ())
    fitting = [length for length in lengths if length < D.size and not D[length:].any()]
    if D.size not in lengths and fitting:
        D = D[: max(fitting)]
    if model == RATIONAL and D.size in PINHOLE_MODELS[PLUMB_BOB]:
        model = PLUMB_BOB
    return model, D


def unnamed_lens(model: str, D: Floats) -> str:
    """Return what is to be said of numbers that are used without the name of their model."""
    if model or not D.any():
        return ''
    return (
        f'distortion_model is empty; the {D.size} numbers of D are used as {_only_model(D)}: '
        'publish the name of the model that was calibrated'
    )


def _only_model(D: Floats) -> str:
    """Return the one model that takes as many numbers (raises CalibrationError)."""
    models = {**PINHOLE_MODELS, 'equidistant': LENGTHS['equidistant']}
    fitting = [model for model, lengths in models.items() if D.size in lengths]
    if len(fitting) == 1:
        return fitting[0]
    raise CalibrationError(
        f"CameraInfo distortion_model '' is unknown: it is empty, and D has {D.size} numbers, as "
        f'of {" or ".join(fitting) or "no model"}; publish the name of the model that was '
        'calibrated'
    )


def with_scale(matrix: Floats) -> Floats:
    """Return a (3, 3) camera matrix whose last number is 1 where its driver left it at 0."""
    filled = matrix.copy()
    if matrix[0, 0] > 0.0 and matrix[1, 1] > 0.0 and matrix[2, 2] == 0.0:
        filled[2, 2] = 1.0
    return filled
