# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The public Python interface: pictures in, poses out, without messages, bags or ROS.

`docs/api.md` describes it and promises that it stays. Everything else may change.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from gip_localizer.core.arrays import Grey
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate
from gip_localizer.core.localizer import Localizer as Core
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.errors import GipError, ImageError, ParameterError, quoted
from gip_localizer.io.camera_info_files import CameraInfo, load_camera_info
from gip_localizer.io.map_files import load_map
from gip_localizer.io.messages import calibration
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.parameters.yaml_files import user_path
from gip_localizer.visualization.overlay import camera_overlay

__all__ = ['Camera', 'Estimate', 'GipError', 'Localizer', 'Pose2', 'draw_overlay', 'load_map']

Image = NDArray[Any]
CHANNELS = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}
"""Number of channels → OpenCV's conversion to grey."""


class Camera:
    """
    A calibrated camera on a vehicle.

    Parameters
    ----------
    width, height : int
        Size of its images, pixels.
    K : (3, 3) array-like
        Camera matrix, pixels.
    D : (n,) array-like
        Distortion; empty for none.
    model : str
        plumb_bob, rational_polynomial or equidistant (fisheye).
    **mounting : float
        Pose in the vehicle: x, y, z (m; z is the height above the road) and roll, pitch, yaw
        (rad; pitch is positive where the camera looks down). What is not given has the default of
        the parameters `camera.*`.

    Raises
    ------
    CalibrationError
        The calibration cannot be used.
    ParameterError
        The mounting is none of these numbers, or outside its range.

    """

    def __init__(self, width: int, height: int, K: ArrayLike, D: ArrayLike = (), *,
                 model: str = 'plumb_bob', **mounting: float) -> None:
        self._set(CameraInfo(int(width), int(height), np.asarray(K, float).ravel(),
                             np.asarray(D, float).ravel(), model), mounting)

    def _set(self, info: CameraInfo, mounting: Mapping[str, float | bool]) -> None:
        given = Parameters().replace(
            {f'camera.{name}': value if isinstance(value, bool) else float(value)
             for name, value in mounting.items()}
        )
        self.model = CameraModel.given(calibration(info), given.camera)

    @classmethod
    def from_file(cls, path: Path | str, *, rectified: bool = False, **mounting: float) -> Camera:
        """
        Read the calibration from a YAML file.

        Parameters
        ----------
        path : Path or str
            As ROS's camera_calibration writes it, or a CameraInfo message.
        rectified : bool
            True: the images are rectified, so P of the file holds, without distortion.
        **mounting : float
            As for `Camera`.

        """
        camera = cls.__new__(cls)
        camera._set(load_camera_info(path), {'rectified': rectified, **mounting})
        return camera


class Localizer:
    """
    Localizes the images of one camera on one map.

    Parameters
    ----------
    road : RasterMap
        Result of `load_map`.
    camera : Camera
        The camera.
    start : sequence of 3 float or None
        Where the vehicle is at the first image: x, y (m) and yaw (rad) in the map frame. None:
        the whole map is searched.
    settings : mapping, path or None
        Parameters by name (docs/parameters.md), for example `{'birdseye.far': 8.0}`, or a ROS
        parameter file. `camera.*` and `initial_pose.set` are those of the other arguments.

    Raises
    ------
    ParameterError
        A setting is unknown or outside its range, or the start is no pose.

    """

    def __init__(self, road: RasterMap, camera: Camera, *, start: Sequence[float] | None = None,
                 settings: Mapping[str, object] | Path | str | None = None) -> None:
        if isinstance(settings, (str, Path)):
            parameters = load_parameter_file(user_path(settings))
        else:
            parameters = Parameters().replace(dict(settings or {}))
        self._parameters = parameters.replace({'initial_pose.set': False})
        self._camera = camera.model
        self._core = Core(road, self._parameters)
        if start is None:
            self.search_map()
        elif isinstance(start, str) or len(start) != 3:
            raise ParameterError(f'start {quoted(start)}: expected (x, y, yaw) in m and rad')
        else:
            self.start_at(*start)

    def start_at(self, x: float, y: float, yaw: float, *, sigma_xy: float | None = None,
                 sigma_yaw: float | None = None) -> None:
        """
        Take a pose in the map frame as the one of the next image.

        Parameters
        ----------
        x, y, yaw : float
            Metres and radians.
        sigma_xy, sigma_yaw : float or None
            Standard deviations, metres and radians; None: `initial_pose.sigma_*`.

        """
        known = self._parameters.initial_pose
        xy = known.sigma_xy if sigma_xy is None else sigma_xy
        turn = known.sigma_yaw if sigma_yaw is None else sigma_yaw
        if min(xy, turn) <= 0.0:
            raise ParameterError(f'sigmas {xy} m, {turn} rad: expected numbers above 0')
        self._core.set_prior(0, Pose2(float(x), float(y), float(yaw)),
                             np.diag([xy**2, xy**2, turn**2]))

    def search_map(self) -> None:
        """
        Search the whole map from the next image on, until the place is found.

        A pose is given when `recovery.confirm_frames` images in a row agree.

        """
        self._core.relocalize()

    def add_odometry(self, stamp_ns: int, x: float, y: float, yaw: float) -> bool:
        """
        Take the pose of the vehicle in the frame of its odometry (m, rad), which may drift.

        Samples must reach to within `motion.max_gap` of the images.

        Returns
        -------
        bool
            False if the sample is refused (it jumps, repeats a stamp, or goes back in time).

        """
        pose = Pose2(float(x), float(y), float(yaw))
        return self._core.add_odometry(OdometrySample(int(stamp_ns), pose))

    def localize(self, image: Image, stamp_ns: int, *, mask: Image | None = None) -> Estimate:
        """
        Localize one image.

        Parameters
        ----------
        image : (height, width) or (height, width, 3 or 4) array
            uint8 or uint16, or float32 in [0, 1]; colours in OpenCV's order, blue first.
        stamp_ns : int
            Time of exposure, nanoseconds; later than that of the image before.
        mask : (height, width) array or None
            Pixels below half of full scale are ignored.

        Returns
        -------
        Estimate
            `pose` (x, y, yaw) and `covariance` in the map frame, or None and `status` with
            `reason`.

        Raises
        ------
        ImageError
            No image of such a type.

        """
        return self._core.update(int(stamp_ns), _grey(image), self._camera, mask=mask)


def draw_overlay(image: Image, estimate: Estimate, camera: Camera, road: RasterMap) -> Image:
    """
    Draw the map into the image at the pose that was found, to check it by eye.

    Parameters
    ----------
    image, estimate, camera, road
        The image that was localized, the result, and what the localizer was made of.

    Returns
    -------
    (height, width, 3) uint8
        Blue, green, red; the map's outlines are green if there is a pose, orange otherwise.

    """
    return camera_overlay(_grey(image), camera.model, road, estimate)


def _grey(image: Image) -> Grey:
    if image is None:
        raise ImageError('the image is None: cv2.imread found no picture at its path')
    pixels = np.asarray(image)
    if pixels.dtype not in (np.uint8, np.uint16, np.float32) or not pixels.size:
        raise ImageError(
            f'the image is of {pixels.dtype} and shape {pixels.shape}; expected pixels of uint8, '
            'uint16 or float32'
        )
    if pixels.ndim == 3 and pixels.shape[2] in CHANNELS:
        return np.asarray(cv2.cvtColor(pixels, CHANNELS[pixels.shape[2]]))
    if pixels.ndim != 2:
        raise ImageError(
            f'the image has shape {pixels.shape}; expected (height, width), or 3 or 4 channels'
        )
    return pixels
