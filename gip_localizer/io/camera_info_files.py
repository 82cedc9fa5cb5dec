# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Calibrations in YAML files: as ROS's camera_calibration writes them, or a CameraInfo message.

Both hold the numbers of a sensor_msgs/CameraInfo: the first under `image_width`, `camera_matrix`
and so on, the second (`ros2 topic echo --once camera_info`) under the names of its fields.

"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.errors import CalibrationError, quoted
from gip_localizer.parameters.yaml_files import read_yaml, user_path, YamlFileError

CALIBRATOR = {
    'width': 'image_width', 'height': 'image_height', 'k': 'camera_matrix',
    'd': 'distortion_coefficients', 'r': 'rectification_matrix', 'p': 'projection_matrix',
}
"""Field of a CameraInfo → key of a file of camera_calibration."""
SIZES = {'k': 9, 'r': 9, 'p': 12}
"""Field → number of its values: sensor_msgs/CameraInfo."""
EXPECTED = (
    'expected image_width, image_height, camera_matrix, distortion_model and '
    'distortion_coefficients as camera_calibration writes them, or width, height, k, '
    'distortion_model and d of a CameraInfo message'
)


@dataclass(frozen=True)
class Region:
    """The roi of a CameraInfo, pixels; zero size: the whole image."""

    x_offset: int = 0
    y_offset: int = 0
    width: int = 0
    height: int = 0


@dataclass(frozen=True, eq=False)
class CameraInfo:
    """
    The fields of a sensor_msgs/CameraInfo without its header, for `io.messages.calibration`.

    Attributes
    ----------
    width, height : int
        Size of the calibrated image, pixels.
    k, r, p : (9,), (9,) and (12,) float64
        Camera matrix, rectification and projection, by rows.
    d : (n,) float64
        Distortion.
    distortion_model : str
        As ROS names it.
    binning_x, binning_y : int
        Pixels joined.
    roi : Region
        The part of the image that is delivered.

    """

    width: int
    height: int
    k: Floats
    d: Floats = field(default_factory=lambda: np.zeros(0))
    distortion_model: str = 'plumb_bob'
    r: Floats = field(default_factory=lambda: np.eye(3).ravel())
    p: Floats = field(default_factory=lambda: np.zeros(12))
    binning_x: int = 0
    binning_y: int = 0
    roi: Region = Region()


def load_camera_info(path: Path | str) -> CameraInfo:
    """
    Read a calibration file.

    Raises
    ------
    CalibrationError
        Missing, no YAML, or without the numbers of a camera; the message names the file.

    """
    path = user_path(path)
    try:
        values = read_yaml(path)
    except FileNotFoundError:
        raise CalibrationError(f'{path}: there is no such calibration file') from None
    except YamlFileError as error:
        raise CalibrationError(f'{path}: {error}; {EXPECTED}') from None
    if not isinstance(values, Mapping):
        raise CalibrationError(f'{path}: holds {quoted(values)}; {EXPECTED}')
    return _camera_info(path, values)


def _camera_info(path: Path, values: Mapping[str, Any]) -> CameraInfo:
    names = CALIBRATOR if 'image_width' in values else {name: name for name in CALIBRATOR}
    missing = [names[name] for name in ('width', 'height', 'k') if names[name] not in values]
    if missing:
        raise CalibrationError(f'{path}: {missing[0]} is missing; {EXPECTED}')
    region = values.get('roi')
    fields = Region.__dataclass_fields__
    given = {name: region[name] for name in fields if name in region} if isinstance(
        region, Mapping) else {}
    numbers = {name: _numbers(path, names[name], values[names[name]], SIZES.get(name))
               for name in ('k', 'd', 'r', 'p') if names[name] in values}
    return CameraInfo(
        width=_whole(path, names['width'], values[names['width']]),
        height=_whole(path, names['height'], values[names['height']]),
        distortion_model=str(values.get('distortion_model', 'plumb_bob')),
        binning_x=_whole(path, 'binning_x', values.get('binning_x', 0)),
        binning_y=_whole(path, 'binning_y', values.get('binning_y', 0)),
        roi=Region(**{name: _whole(path, f'roi.{name}', value) for name, value in given.items()}),
        **numbers,
    )


def _numbers(path: Path, name: str, value: Any, size: int | None) -> Floats:
    """Return the numbers of a list, or of a matrix with rows, cols and data."""
    listed = value.get('data') if isinstance(value, Mapping) else value
    try:
        numbers = np.asarray(listed, float).ravel()
    except (TypeError, ValueError):
        raise CalibrationError(f'{path}: {name} is {quoted(value)}; expected numbers') from None
    if size is not None and numbers.size != size:
        raise CalibrationError(f'{path}: {name} has {numbers.size} numbers; expected {size}')
    return numbers


def _whole(path: Path, name: str, value: Any) -> int:
    if not isinstance(value, int):
        raise CalibrationError(f'{path}: {name} is {quoted(value)}; expected a whole number')
    return int(value)
