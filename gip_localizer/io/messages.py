# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages → types of the core; duck-typed, for messages of rclpy and of rosbags."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.errors import CalibrationError, GipError
from gip_localizer.io.lens import lens, unnamed_lens, with_scale

PLANAR = np.ix_([0, 1, 5], [0, 1, 5])
"""Indices (no unit) of x, y and yaw in a 6 x 6 covariance: order of geometry_msgs."""
MAX_IMAGE_SIDE = 65536
"""Largest width and height (px) of an image; chosen, far above any camera."""
UNOBSERVED = 1.0
"""Variance of z (m²), roll and pitch (rad²), which are not estimated; chosen."""
FARTHEST = 1e9
"""Largest distance (m) from the origin of a frame; chosen above that of any map projection."""


class PoseMessageError(GipError):
    """A pose message holds no usable pose."""


def stamp_ns(header: Any) -> int:
    """Return the stamp of a std_msgs/Header in nanoseconds."""
    return int(header.stamp.sec) * 1_000_000_000 + int(header.stamp.nanosec)


def planar_pose(pose: Any) -> Pose2:
    """
    Return x, y and yaw of a geometry_msgs/Pose.

    Raises
    ------
    PoseMessageError
        NaN, a position beyond `FARTHEST`, or a quaternion whose length differs from 1 by more
        than 0.1.

    """
    q = pose.orientation
    numbers = (pose.position.x, pose.position.y, q.x, q.y, q.z, q.w)
    if not all(math.isfinite(value) for value in numbers):
        raise PoseMessageError('pose holds NaN or infinity')
    if max(abs(pose.position.x), abs(pose.position.y)) > FARTHEST:
        raise PoseMessageError(
            f'pose is at ({pose.position.x:.3g}, {pose.position.y:.3g}) m; expected a local frame'
        )
    norm = math.hypot(q.x, q.y, q.z, q.w)
    if abs(norm - 1.0) > 0.1:
        raise PoseMessageError(f'orientation quaternion has length {norm:.3g}; expected 1')
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), norm**2 - 2.0 * (q.y**2 + q.z**2))
    return Pose2(float(pose.position.x), float(pose.position.y), yaw)


def planar_covariance(covariance: Any) -> Floats:
    """
    Return the (3, 3) part for x, y, yaw of a 6 x 6 row-major covariance (REP 103).

    Raises
    ------
    PoseMessageError
        Another number of values than 36.

    """
    full = np.asarray(covariance, float)
    if full.size != 36:
        raise PoseMessageError(f'covariance holds {full.size} values; expected 36')
    return full.reshape(6, 6)[PLANAR]


def full_covariance(covariance: Floats) -> Floats:
    """Return a (36,) covariance, row-major of x y z r p y: (3, 3) of x, y, yaw; UNOBSERVED."""
    full = np.diag(np.full(6, UNOBSERVED))
    full[PLANAR] = covariance
    return full.ravel()


def quaternion_of_yaw(yaw: float) -> tuple[float, float, float, float]:
    """Return x, y, z, w."""
    return 0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)


def odometry(message: Any) -> OdometrySample:
    """Return a nav_msgs/Odometry as a sample (raises PoseMessageError)."""
    twist = message.twist.twist
    return OdometrySample(
        stamp_ns(message.header), planar_pose(message.pose.pose),
        float(twist.linear.x), float(twist.linear.y), float(twist.angular.z),
    )


def calibration(message: Any) -> Calibration:
    """
    Return the numbers of a sensor_msgs/CameraInfo.

    The fields are `k`, `d`, `r`, `p` in ROS 2, and `K`, `D`, `R`, `P` in older types.

    Raises
    ------
    CalibrationError
        Uncalibrated or unusable (see `Calibration`).

    """
    width, height = int(message.width), int(message.height)
    if max(width, height) > MAX_IMAGE_SIDE:
        raise CalibrationError(f'CameraInfo size {width}x{height} is too large; expected at most '
                               f'{MAX_IMAGE_SIDE} px per side; check the calibration')
    roi = message.roi
    rotation = _numbers(message, 'r').reshape(3, 3)
    model, distortion = lens(str(message.distortion_model), _numbers(message, 'd'))
    return Calibration(
        width, height, with_scale(_numbers(message, 'k').reshape(3, 3)), distortion,
        with_scale(_numbers(message, 'p').reshape(3, 4)[:, :3]), model,
        rotation if rotation.any() else np.eye(3),
        (max(int(message.binning_x), 1), max(int(message.binning_y), 1)),
        (int(roi.x_offset), int(roi.y_offset), int(roi.width), int(roi.height)),
    )


def calibration_note(message: Any) -> str:
    """Return a remark on a usable CameraInfo; empty in most cases."""
    return unnamed_lens(str(message.distortion_model), _numbers(message, 'd'))


def calibration_text(message: Any) -> str:
    """Return a CameraInfo in words: size, focal lengths and lens model."""
    k = _numbers(message, 'k')
    return (
        f'{message.width} x {message.height} pixels, focal lengths {k[0]:.1f} and {k[4]:.1f} px, '
        f'{message.distortion_model or "no distortion model"}'
    )


def _numbers(message: Any, name: str) -> Floats:
    """Return a matrix of a CameraInfo, flat, by its name in lower case."""
    values = getattr(message, name) if hasattr(message, name) else getattr(message, name.upper())
    return np.asarray(values, float).ravel()


def fingerprint(message: Any) -> tuple[object, ...]:
    """Return the content of a CameraInfo without its header, for detecting a change."""
    roi = message.roi
    matrices = [getattr(message, name, None) for name in ('k', 'd', 'p', 'r')]
    return (
        message.width, message.height, message.distortion_model, message.binning_x,
        message.binning_y, roi.x_offset, roi.y_offset, roi.width, roi.height,
        *(None if m is None else tuple(float(v) for v in m) for m in matrices),
    )


def other_frame(word: str, frame: str, name: str, expected: str) -> str:
    """Return how the frame of odometry is wrong; empty if it is right or not set."""
    if not frame or frame.lstrip('/') == expected.lstrip('/'):
        return ''
    return f'odometry is {word} frame {frame!r}, expected {name} {expected!r}'
