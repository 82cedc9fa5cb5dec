# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Focal plane geometry (section of that name in the paper).

The camera is at the origin, `h` above a flat road. z is the depth along the optical axis, which is
pitched down by `θ` below the horizon; x is lateral. Lengths are in centimetres, as in the paper.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.errors import ParameterError


@dataclass(frozen=True)
class PaperCamera:
    """
    The camera, noise and squares of the paper's simulated performance.

    Attributes
    ----------
    height : float
        h, height above the road, cm.
    pitch_deg : float
        θ, optical axis below the horizon, degrees.
    fov_vertical_deg, fov_horizontal_deg : float
        Whole fields of view, degrees.
    focal_length : float
        f, cm.
    square : float
        Side of a square on the road, cm.
    noise_density : float
        N0, power spectral density of the sensor noise, cm² × amplitude².

    Raises
    ------
    ParameterError
        A number is not finite, not positive, or not an angle that a camera can have.

    """

    height: float = 58.3095
    pitch_deg: float = 35.9020
    fov_vertical_deg: float = 39.2962
    fov_horizontal_deg: float = 70.5288
    focal_length: float = 0.0367
    square: float = 20.0
    noise_density: float = 0.0018

    def __post_init__(self) -> None:
        """Refuse impossible values."""
        for name, value in vars(self).items():
            limit = math.inf if not name.endswith('_deg') else 180.0
            if name == 'pitch_deg':
                limit = 90.0
            if not (math.isfinite(value) and 0.0 < value < limit):
                wanted = 'positive' if math.isinf(limit) else f'between 0 and {limit:g}'
                raise ParameterError(
                    f'camera parameter {name} is {value:g}; give a number that is {wanted}'
                )

    @property
    def theta(self) -> float:
        """θ in radians."""
        return math.radians(self.pitch_deg)

    @property
    def area_constant(self) -> float:
        """`f² h secθ`, cm³: footprint per entry of the Gramian."""
        return self.focal_length**2 * self.height / math.cos(self.theta)

    @property
    def snr_constant(self) -> float:
        """`f² h secθ / N0`, the constant under the root of WeightedCDF."""
        return self.area_constant / self.noise_density


def project(camera: PaperCamera, x: Floats, z: Floats) -> tuple[Floats, Floats]:
    """
    Project road points to the focal plane, equations Tilde and yTildeFunctionOfZ.

    Parameters
    ----------
    camera : PaperCamera
        Camera.
    x, z : array of float64
        Lateral position and depth of road points, cm; the road has y = z tanθ − h secθ.

    Returns
    -------
    x_tilde, y_tilde : array of float64
        `f x / z` and `f tanθ − (f h / z) secθ`, cm.

    """
    f, h, theta = camera.focal_length, camera.height, camera.theta
    return f * x / z, f * math.tan(theta) - (f * h / z) / math.cos(theta)


def depth_of_row(camera: PaperCamera, y_tilde: Floats) -> Floats:
    """
    Depth of the road at a row of the focal plane, equation z: `f h / (f sinθ − ỹ cosθ)`.

    This quotient is also the correct second argument of g in `g̃(x̃, ỹ)`; the paper prints
    `h ỹ / (f sinθ − ỹ cosθ)` there, which is y and not z.

    """
    f, h, theta = camera.focal_length, camera.height, camera.theta
    depth: Floats = f * h / (f * math.sin(theta) - y_tilde * math.cos(theta))
    return depth


def depth_of_distance(camera: PaperCamera, distance: Floats) -> Floats:
    """Depth `z = d cosθ + h sinθ` of road points at ground distance d ahead, cm."""
    return distance * math.cos(camera.theta) + camera.height * math.sin(camera.theta)


def jacobian(camera: PaperCamera, x: float, z: float) -> Floats:
    """
    Return the derivatives of (x̃, ỹ) along x (first row) and z (second row), equation Jacobian.

    Corrected: ∂ỹ/∂z is `+ f h secθ / z²`, by yTildeFunctionOfZ; the paper prints a minus. The
    magnitude of the determinant (DeterminantJacobian) is `f² h secθ / z³` either way.

    """
    f, h, sec = camera.focal_length, camera.height, 1.0 / math.cos(camera.theta)
    return np.array([[f / z, 0.0], [-f * x / z**2, f * h * sec / z**2]])
