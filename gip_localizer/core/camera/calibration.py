# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The numbers of a `sensor_msgs/CameraInfo` (REP 104), judged before they are used."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.errors import CalibrationError

# Distortion models of sensor_msgs/CameraInfo, and their numbers of coefficients (OpenCV).
PINHOLE_MODELS = {'plumb_bob': (4, 5), 'rational_polynomial': (8, 12, 14)}
FISHEYE_MODELS = ('equidistant', 'fisheye')
# Largest absolute number of a CameraInfo (px, or no unit; design choice: 1e7, because no camera
# has as many pixels per side, and larger numbers are errors).
LARGEST = 1e7


@dataclass(frozen=True, eq=False)
class Calibration:
    """
    The numbers of a CameraInfo.

    Attributes
    ----------
    width, height : int
        Size of the calibrated (full) image, pixels.
    K : (3, 3) float64
        Intrinsics of the raw image.
    D : (n,) float64
        Distortion; empty for none.
    P : (3, 3) float64
        Left part of the projection of the rectified image; zeros when absent.
    model : str
        plumb_bob, rational_polynomial or equidistant.
    R : (3, 3) float64
        Rectification rotation, applied only to rectified images.
    binning : (2,) int
        Number of pixels per pixel of the image, in x and in y.
    roi : (4,) int
        x, y, width, height of the delivered part of the full image; zero size: all of it.

    Raises
    ------
    CalibrationError
        Sizes, numbers or the model name are unusable.

    """

    width: int
    height: int
    K: Floats
    D: Floats = field(default_factory=lambda: np.zeros(0))
    P: Floats = field(default_factory=lambda: np.zeros((3, 3)))
    model: str = 'plumb_bob'
    R: Floats = field(default_factory=lambda: np.eye(3))
    binning: tuple[int, int] = (1, 1)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)

    def __post_init__(self) -> None:
        """Refuse what cannot be a calibration."""
        for name, values in (('K', self.K), ('D', self.D), ('P', self.P), ('R', self.R)):
            if not np.all(np.isfinite(values)):
                raise CalibrationError(f'CameraInfo {name} holds NaN or infinity; recalibrate')
            if values.size and np.abs(values).max() > LARGEST:
                raise CalibrationError(
                    f'CameraInfo {name} holds {np.abs(values).max():.3g}, beyond any camera; '
                    'recalibrate'
                )
        if self.width < 1 or self.height < 1:
            raise CalibrationError(
                f'CameraInfo size is {self.width}x{self.height}; expected the calibrated size'
            )
        check_matrix('K', self.K)
        self._check_model()
        x, y, width, height = self.roi
        if min(x, y, width, height) < 0 or x + width > self.width or y + height > self.height:
            raise CalibrationError(
                f'CameraInfo roi {self.roi} leaves the image of {self.width}x{self.height}'
            )

    def _check_model(self) -> None:
        if self.D.size == 0 or not np.any(self.D):
            return
        if self.model in FISHEYE_MODELS:
            allowed: tuple[int, ...] = (4,)
        elif self.model in PINHOLE_MODELS:
            allowed = PINHOLE_MODELS[self.model]
        else:
            raise CalibrationError(
                f'CameraInfo distortion_model {self.model!r} is unknown; expected '
                'plumb_bob, rational_polynomial or equidistant'
            )
        if self.D.size not in allowed:
            raise CalibrationError(
                f'CameraInfo D has {self.D.size} numbers; {self.model} takes '
                f'{" or ".join(map(str, allowed))}'
            )

    def key(self) -> tuple[object, ...]:
        """Return a hashable value that is equal for equal calibrations."""
        return (
            self.width, self.height, self.K.tobytes(), self.D.tobytes(), self.P.tobytes(),
            self.model, self.R.tobytes(), self.binning, self.roi,
        )

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the delivered image, after ROI and binning."""
        width, height = self.roi[2] or self.width, self.roi[3] or self.height
        return width // self.binning[0], height // self.binning[1]


def check_matrix(name: str, matrix: Floats) -> None:
    """Refuse focal lengths that no calibrated camera has (raises CalibrationError)."""
    if matrix[0, 0] <= 0.0 or matrix[1, 1] <= 0.0 or matrix[2, 2] == 0.0:
        raise CalibrationError(
            f'CameraInfo {name} has focal lengths {matrix[0, 0]:g} and {matrix[1, 1]:g}: '
            'the camera is not calibrated; publish a calibrated CameraInfo'
        )
    below = matrix[[1, 2, 2], [0, 0, 1]]
    if np.any(below != 0.0) or matrix[2, 2] != 1.0:
        raise CalibrationError(
            f'CameraInfo {name} is no camera matrix: its rows are {matrix.tolist()}; '
            'expected zeros below the diagonal and 1 at its end'
        )
