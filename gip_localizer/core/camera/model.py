# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Camera geometry: a calibrated camera above a flat road, pixel ↔ road plane.

The numbers of a `sensor_msgs/CameraInfo` (REP 104) and six extrinsics give the map both ways:
between road and undistorted image one homography, and behind it the lens model, both OpenCV's.
Pixel centres lie at integer coordinates, as in OpenCV.

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey
from gip_localizer.core.camera.calibration import Calibration, check_matrix, FISHEYE_MODELS
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Camera

# Rotation from the camera's body frame (x forward) to its optical frame (z forward), REP 103.
OPTICAL_FROM_BODY = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
LEAST_DEPTH = 1e-6  # m along the optical axis: what lies nearer or behind is not in front
HORIZON_MARGIN = 1e-3  # least depression of a ray, rad: beyond about 1000 camera heights is sky
SIZE_SLACK = 1  # px by which an image may differ from its calibration (rounding of binning)
FOLD_RAYS = np.linspace(0.0, 10.0, 4001)  # radii at which a lens model is checked for folding


@dataclass(frozen=True)
class Extrinsics:
    """
    Pose of the camera body (x forward, y left, z up) in the base frame.

    `R_base_camera = Rz(yaw) Ry(pitch) Rx(roll)`; metres and radians; positive pitch is nose
    down (the paper's θ); z is the height above the road (the paper's h).

    """

    x: float = 0.0
    y: float = 0.0
    z: float = 1.5
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    def rotation(self) -> Floats:
        """Return R_base_optical, (3, 3): optical axes (z forward, x right) in base."""
        cr, sr = np.cos(self.roll), np.sin(self.roll)
        cp, sp = np.cos(self.pitch), np.sin(self.pitch)
        cy, sy = np.cos(self.yaw), np.sin(self.yaw)
        rx = np.array([[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
        ry = np.array([[cp, 0.0, sp], [0.0, 1.0, 0.0], [-sp, 0.0, cp]])
        rz = np.array([[cy, -sy, 0.0], [sy, cy, 0.0], [0.0, 0.0, 1.0]])
        rotation: Floats = rz @ ry @ rx @ OPTICAL_FROM_BODY.T
        return rotation

    def position(self) -> Floats:
        """Return the camera position in base, (3,) metres."""
        return np.array([self.x, self.y, self.z])


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
        True: images are rectified, so P holds and D is ignored.

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
        """Return the same camera held elsewhere."""
        return CameraModel(self.calibration, extrinsics, rectified=self.rectified)

    @classmethod
    def given(cls, calibration: Calibration, held: Camera) -> CameraModel:
        """Return the camera where parameters have it (raises CalibrationError)."""
        extrinsics = Extrinsics(held.x, held.y, held.z, held.roll, held.pitch, held.yaw)
        return cls(calibration, extrinsics, rectified=held.rectified)

    def for_image(self, image: Grey) -> CameraModel:
        """
        Return the camera that delivers an image, itself unless sizes differ by a rounding.

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
        """Say so where the image has the size that CameraInfo states before its binning."""
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
        """Homography back: `H_image_road` inverted, times the camera's height."""
        rotation, (x, y, z) = self.R_base_camera, self.extrinsics.position()
        return np.stack([
            x * rotation[2] - z * rotation[0], y * rotation[2] - z * rotation[1], rotation[2]
        ])

    def project(self, points_base: Floats) -> tuple[Floats, Bools]:
        """
        Pixels of points in the base frame.

        Parameters
        ----------
        points_base : (n, 3) or (n, 2) float64
            Metres; two columns mean points on the road.

        Returns
        -------
        uv : (n, 2) float64
            Pixel column and row; NaN where not valid.
        valid : (n,) bool
            In front of the camera and inside the lens model's range (not only in the image).

        """
        points = np.asarray(points_base, float)
        if points.shape[1] == 2:
            H = self.H_image_road
            return self._pixels(_transformed(points, H), points @ H[2, :2] + H[2, 2])
        optical = (points - self.extrinsics.position()) @ self.R_base_camera
        depth = optical[:, 2]
        rays = optical[:, :2] / np.where(depth > LEAST_DEPTH, depth, 1.0)[:, None]
        return self._pixels(rays, depth)

    def _pixels(self, rays: Floats, depth: Floats) -> tuple[Floats, Bools]:
        """Pixels of undistorted rays (n, 2) to points at a depth (n,), as `project`."""
        valid = (depth > LEAST_DEPTH) & (np.hypot(rays[:, 0], rays[:, 1]) < self.max_radius)
        uv = self._distort(np.where(valid[:, None], rays, 0.0))
        uv[~valid] = np.nan
        return uv, valid

    def road_points(self, uv: Floats) -> tuple[Floats, Bools]:
        """
        Where the rays of pixels meet the road.

        Parameters
        ----------
        uv : (n, 2) float64
            Pixel column and row.

        Returns
        -------
        xy : (n, 2) float64
            Road points in base, metres; NaN where not valid.
        valid : (n,) bool
            False at or above the horizon, and outside the lens model's range.

        """
        rays, valid = self.rays(np.asarray(uv, float))
        return self.intersect_road(rays, valid)

    def rays(self, uv: Floats) -> tuple[Floats, Bools]:
        """Undistorted normalised coordinates (n, 2) of pixels, and whether they exist (n,)."""
        normalised = (uv - self.K[:2, 2]) / self.K[[0, 1], [0, 1]]
        if self.D.size == 0:
            finite: Bools = np.isfinite(normalised[:, 0]) & np.isfinite(normalised[:, 1])
            return normalised, finite
        rays = self._undistort(uv)
        radius = np.hypot(rays[:, 0], rays[:, 1])
        valid = np.isfinite(radius) & (radius < self.max_radius)
        back = self._distort(np.where(valid[:, None], rays, 0.0))
        valid &= np.abs(back - uv).max(axis=1) < 0.01
        return rays, valid

    def intersect_road(self, rays: Floats, valid: Bools) -> tuple[Floats, Bools]:
        """Road points (n, 2) in base of undistorted normalised rays (n, 2)."""
        safe = np.where(valid[:, None], rays, 0.0)
        rise = safe @ self.R_base_camera[2, :2] + self.R_base_camera[2, 2]
        norm = np.hypot(np.hypot(safe[:, 0], safe[:, 1]), 1.0)
        valid = valid & (rise < -HORIZON_MARGIN * norm)
        xy = _transformed(safe, self.H_road_image)
        xy[~valid] = np.nan
        return xy, valid

    @cached_property
    def max_radius(self) -> float:
        """Largest undistorted radius before the lens model folds back (inf for no lens)."""
        if self.D.size == 0:
            return np.inf
        if self.fisheye:
            theta = np.linspace(0.0, 0.499 * np.pi, 2001)
            powers = theta[:, None] ** (2 * np.arange(1, 5))
            slope = 1.0 + powers @ (self.D * (2 * np.arange(1, 5) + 1))
            return float(np.tan(theta[_first_fold(slope)]))
        radii = FOLD_RAYS[1:]
        coefficients = np.zeros(8)
        coefficients[: min(self.D.size, 8)] = self.D[:8]
        k1, k2, _, _, k3, k4, k5, k6 = coefficients
        s = radii**2
        top, bottom = 1 + s * (k1 + s * (k2 + s * k3)), 1 + s * (k4 + s * (k5 + s * k6))
        distorted = np.where(bottom > 0, radii * top / np.where(bottom > 0, bottom, 1.0), -1.0)
        return float(radii[_first_fold(np.diff(distorted, prepend=0.0))])

    def _distort(self, rays: Floats) -> Floats:
        if self.D.size == 0:
            return rays * self.K[[0, 1], [0, 1]] + self.K[:2, 2]
        if len(rays) == 0:
            return np.zeros((0, 2))
        zero = np.zeros(3)
        if self.fisheye:
            points = np.column_stack([rays, np.ones(len(rays))])[None]
            uv, _ = cv2.fisheye.projectPoints(points, zero, zero, self.K, self.D)
        else:
            points = np.column_stack([rays, np.ones(len(rays))])[:, None]
            uv, _ = cv2.projectPoints(points, zero, zero, self.K, self.D)
        return np.asarray(uv, float).reshape(-1, 2)

    def _undistort(self, uv: Floats) -> Floats:
        if len(uv) == 0:
            return np.zeros((0, 2))
        points = np.ascontiguousarray(uv)[:, None]
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-9)
        if self.fisheye:
            rays = cv2.fisheye.undistortPoints(points, self.K, self.D, criteria=criteria)
        elif hasattr(cv2, 'undistortPointsIter'):
            eye = np.eye(3)
            rays = cv2.undistortPointsIter(points, self.K, self.D, eye, eye, criteria)
        else:
            rays = cv2.undistortPoints(points, self.K, self.D, criteria=criteria)
        return np.asarray(rays, float).reshape(-1, 2)


def _transformed(points: Floats, homography: Floats) -> Floats:
    """Points (n, 2) of a plane under a homography (3, 3), by OpenCV."""
    if len(points) == 0:
        return np.zeros((0, 2))
    return np.asarray(cv2.perspectiveTransform(points[:, None], homography)[:, 0])


def _first_fold(slope: Floats) -> int:
    """Index of the last entry before the slope first stops being positive."""
    folded = np.flatnonzero(slope <= 0.0)
    return max(int(folded[0]) - 1, 0) if folded.size else len(slope) - 1


def _delivered_intrinsics(matrix: Floats, calibration: Calibration) -> Floats:
    """Intrinsics of the delivered image: first the ROI, then binning (REP 104)."""
    K = np.array(matrix[:3, :3], float) / matrix[2, 2]
    K[0, 2] -= calibration.roi[0]
    K[1, 2] -= calibration.roi[1]
    for axis, joined in enumerate(calibration.binning):
        K[axis, axis] /= joined
        K[axis, 2] = (K[axis, 2] + 0.5) / joined - 0.5
    K[0, 1] = 0.0
    return K
