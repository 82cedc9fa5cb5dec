# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Camera geometry: a calibrated camera above a flat road, pixel ↔ road plane.

The numbers of a `sensor_msgs/CameraInfo` (REP 104) and six extrinsics define both directions: a
homography between road and undistorted image, and the lens model (`lens`) between undistorted and
distorted image. Pixel centres are at integer coordinates, as in OpenCV.

"""

from __future__ import annotations

from functools import cached_property

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey
from gip_localizer.core.camera.calibration import Calibration, check_matrix, FISHEYE_MODELS
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.lens import distorted, largest_radius, undistorted
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Camera

# Least depth (m) along the optical axis of a point in front of the camera (design choice: 1e-6 m,
# because a division by a smaller depth is inaccurate).
MIN_DEPTH = 1e-6
# Least angle (rad) of a ray below the horizon (design choice: 1e-3 rad, because the road then is
# 1000 camera heights away, where a pixel covers too much of it).
HORIZON_MARGIN = 1e-3
# Largest difference (px) of the size of an image from that of its calibration (rounding of
# binning).
SIZE_SLACK = 1
# Largest error (px) of undistortion and distortion in turn (design choice: 0.01 px, because a
# larger one shows that the lens model has no unique inverse there).
MAX_ROUND_TRIP = 0.01


class CameraModel:
    """
    Pixel ↔ road plane for one calibration and one set of extrinsics.

    Parameters
    ----------
    calibration : Calibration
        Numbers of the CameraInfo.
    extrinsics : Extrinsics
        Pose of the camera in the base frame.
    rectified : bool
        True: images are rectified, so P is used and D is ignored.

    Raises
    ------
    CalibrationError
        `rectified` without a usable P.

    """

    def __init__(
        self, calibration: Calibration, extrinsics: Extrinsics, *, rectified: bool = False
    ) -> None:
        self.calibration = calibration
        self.extrinsics = extrinsics
        self.rectified = rectified
        if rectified:
            check_matrix('P', calibration.P)
        intrinsics = calibration.P if rectified else calibration.K
        self.K = _delivered_intrinsics(intrinsics, calibration)
        self.fisheye = not rectified and calibration.model in FISHEYE_MODELS
        self.D = np.zeros(0) if rectified or not np.any(calibration.D) else calibration.D
        if self.fisheye and self.D.size == 0:
            self.D = np.zeros(4)  # an ideal one, which is no pinhole
        self.width, self.height = calibration.image_size
        rotation = extrinsics.rotation()
        self.R_base_camera = rotation @ calibration.R.T if rectified else rotation

    def key(self) -> tuple[object, ...]:
        """Return a hashable value that is equal for equal models."""
        size = (self.width, self.height)
        return (*self.calibration.key(), self.extrinsics, self.rectified, size)

    def with_extrinsics(self, extrinsics: Extrinsics) -> CameraModel:
        """Return the same camera at another pose."""
        return CameraModel(self.calibration, extrinsics, rectified=self.rectified)

    @classmethod
    def given(cls, calibration: Calibration, mount: Camera) -> CameraModel:
        """Return the camera at the pose of the parameters (raises CalibrationError)."""
        extrinsics = Extrinsics(
            mount.x, mount.y, mount.z, mount.roll, mount.pitch, mount.yaw
        )
        return cls(calibration, extrinsics, rectified=mount.rectified)

    def for_image(self, image: Grey) -> CameraModel:
        """
        Return the camera for an image, whose size may differ by rounding.

        Raises
        ------
        CalibrationError
            The calibration is for images of another size.

        """
        height, width = image.shape
        if (width, height) == (self.width, self.height):
            return self
        if max(abs(width - self.width), abs(height - self.height)) > SIZE_SLACK:
            raise CalibrationError(
                f'the image is {width}x{height}, its CameraInfo is for '
                f'{self.width}x{self.height}; publish the CameraInfo of this camera and mode'
                + self._binned_twice(width, height)
            )
        other = CameraModel(self.calibration, self.extrinsics, rectified=self.rectified)
        other.width, other.height = width, height
        return other

    def _binned_twice(self, width: int, height: int) -> str:
        """Return a hint if the image has the size of the CameraInfo before binning, else ''."""
        stated, binned = self.calibration, self.calibration.binning
        if max(binned) == 1 or (width, height) != (stated.width, stated.height):
            return ''
        return (f'; it is the size before binning {binned[0]}x{binned[1]}: CameraInfo states the '
                'size of the full sensor, or binning 1')

    @cached_property
    def H_image_road(self) -> Floats:
        """Homography from road (x, y, 1) in base to undistorted normalised image, times depth."""
        rotation, position = self.R_base_camera, self.extrinsics.position()
        columns = [rotation[0], rotation[1], -rotation.T @ position]
        return np.stack(columns, axis=1)

    @cached_property
    def H_road_image(self) -> Floats:
        """Inverse of `H_image_road`, times the height of the camera."""
        rotation, (x, y, z) = self.R_base_camera, self.extrinsics.position()
        return np.stack([
            x * rotation[2] - z * rotation[0], y * rotation[2] - z * rotation[1], rotation[2]
        ])

    def project(self, points_base: Floats) -> tuple[Floats, Bools]:
        """
        Return pixels of points in the base frame.

        Parameters
        ----------
        points_base : (n, 3) or (n, 2) float64
            Metres; two columns mean points on the road.

        Returns
        -------
        uv : (n, 2) float64
            Pixel column and row; NaN where not valid.
        valid : (n,) bool
            In front of the camera and in the range of the lens model (not only in the image).

        """
        points = np.asarray(points_base, float)
        if points.shape[1] == 2:
            H = self.H_image_road
            return self._pixels(_transformed(points, H), points @ H[2, :2] + H[2, 2])
        optical = (points - self.extrinsics.position()) @ self.R_base_camera
        depth = optical[:, 2]
        rays = optical[:, :2] / np.where(depth > MIN_DEPTH, depth, 1.0)[:, None]
        return self._pixels(rays, depth)

    def _pixels(self, rays: Floats, depth: Floats) -> tuple[Floats, Bools]:
        """Pixels of undistorted rays (n, 2) to points at a depth (n,), as `project`."""
        valid = (depth > MIN_DEPTH) & (np.hypot(rays[:, 0], rays[:, 1]) < self.max_radius)
        uv = distorted(
            np.where(valid[:, None], rays, 0.0), self.K, self.D, fisheye=self.fisheye
        )
        uv[~valid] = np.nan
        return uv, valid

    def road_points(self, uv: Floats) -> tuple[Floats, Bools]:
        """
        Return the points where the rays of pixels meet the road.

        Parameters
        ----------
        uv : (n, 2) float64
            Pixel column and row.

        Returns
        -------
        xy : (n, 2) float64
            Road points in base, metres; NaN where not valid.
        valid : (n,) bool
            False at or above the horizon, and outside the range of the lens model.

        """
        rays, valid = self.rays(np.asarray(uv, float))
        return self.intersect_road(rays, valid)

    def rays(self, uv: Floats) -> tuple[Floats, Bools]:
        """Return undistorted normalised rays (n, 2) of pixels, and whether they exist (n,)."""
        normalised = (uv - self.K[:2, 2]) / self.K[[0, 1], [0, 1]]
        if self.D.size == 0:
            finite: Bools = np.isfinite(normalised[:, 0]) & np.isfinite(normalised[:, 1])
            return normalised, finite
        rays = undistorted(uv, self.K, self.D, fisheye=self.fisheye)
        radius = np.hypot(rays[:, 0], rays[:, 1])
        valid = np.isfinite(radius) & (radius < self.max_radius)
        back = distorted(
            np.where(valid[:, None], rays, 0.0), self.K, self.D, fisheye=self.fisheye
        )
        valid &= np.abs(back - uv).max(axis=1) < MAX_ROUND_TRIP
        return rays, valid

    def intersect_road(self, rays: Floats, valid: Bools) -> tuple[Floats, Bools]:
        """Return road points (n, 2) in base of undistorted normalised rays (n, 2)."""
        safe = np.where(valid[:, None], rays, 0.0)
        rise = safe @ self.R_base_camera[2, :2] + self.R_base_camera[2, 2]
        norm = np.hypot(np.hypot(safe[:, 0], safe[:, 1]), 1.0)
        valid = valid & (rise < -HORIZON_MARGIN * norm)
        xy = _transformed(safe, self.H_road_image)
        xy[~valid] = np.nan
        return xy, valid

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius before the lens model folds back (inf without a lens)."""
        return largest_radius(self.D, fisheye=self.fisheye)

def _transformed(points: Floats, homography: Floats) -> Floats:
    """Return points (n, 2) of a plane after a homography (3, 3)."""
    if len(points) == 0:
        return np.zeros((0, 2))
    return np.asarray(cv2.perspectiveTransform(points[:, None], homography)[:, 0])


def _delivered_intrinsics(matrix: Floats, calibration: Calibration) -> Floats:
    """Return the intrinsics of the delivered image: first ROI, then binning (REP 104)."""
    K = np.array(matrix[:3, :3], float) / matrix[2, 2]
    K[0, 2] -= calibration.roi[0]
    K[1, 2] -= calibration.roi[1]
    for axis, binned in enumerate(calibration.binning):
        K[axis, axis] /= binned
        K[axis, 2] = (K[axis, 2] + 0.5) / binned - 0.5
    K[0, 1] = 0.0
    return K
