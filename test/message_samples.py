# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of Jazzy's types, as a bag delivers them."""

from __future__ import annotations

from typing import Any

import numpy as np

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.pose import Pose2
from gip_localizer.io.bags.writer import make, make_header, make_pose


def image_message(pixels: np.ndarray, encoding: str, *, stamp_ns: int = 0, width: int = 0,
                  pad: int = 0, big_endian: bool = False) -> Any:
    """An Image of rows (height, bytes or values per row), each padded by some bytes."""
    if pixels.dtype == np.uint16:
        pixels = pixels.astype('>u2' if big_endian else '<u2')
    height = pixels.shape[0]
    rows = np.ascontiguousarray(pixels).view(np.uint8).reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, pad)), constant_values=0xA5)
    return make(
        'sensor_msgs/msg/Image', header=make_header(stamp_ns, 'camera'), height=height,
        width=width or pixels.shape[1], encoding=encoding, is_bigendian=int(big_endian),
        step=padded.shape[1], data=padded.ravel(),
    )


def compressed_message(content: bytes, kind: str = 'jpeg', *, stamp_ns: int = 0) -> Any:
    return make('sensor_msgs/msg/CompressedImage', header=make_header(stamp_ns, 'camera'),
                format=kind, data=np.frombuffer(content, np.uint8))


def camera_info(calibration: Calibration, *, stamp_ns: int = 0, **changes: Any) -> Any:
    roi = make('sensor_msgs/msg/RegionOfInterest', x_offset=calibration.roi[0],
               y_offset=calibration.roi[1], width=calibration.roi[2],
               height=calibration.roi[3], do_rectify=False)
    P = np.hstack([calibration.P, np.zeros((3, 1))])
    numbers = {
        'height': calibration.height, 'width': calibration.width,
        'distortion_model': calibration.model, 'd': calibration.D, 'k': calibration.K.ravel(),
        'r': calibration.R.ravel(), 'p': P.ravel(), 'binning_x': calibration.binning[0],
        'binning_y': calibration.binning[1], 'roi': roi,
    }
    return make('sensor_msgs/msg/CameraInfo', header=make_header(stamp_ns, 'camera'),
                **{**numbers, **changes})


def initial_pose(pose: Pose2, covariance: np.ndarray, *, frame: str = 'map',
                 stamp_ns: int = 0) -> Any:
    full = np.zeros((6, 6))
    full[np.ix_([0, 1, 5], [0, 1, 5])] = covariance
    return make(
        'geometry_msgs/msg/PoseWithCovarianceStamped', header=make_header(stamp_ns, frame),
        pose=make('geometry_msgs/msg/PoseWithCovariance', pose=make_pose(pose),
                  covariance=full.ravel()),
    )


def odometry_message(stamp_ns: int, pose: Pose2, *, forward: float = 0.0, turn: float = 0.0,
                     child: str = 'base_link') -> Any:
    def vector(x: float, y: float, z: float) -> Any:
        return make('geometry_msgs/msg/Vector3', x=x, y=y, z=z)

    twist = make('geometry_msgs/msg/Twist', linear=vector(forward, 0.0, 0.0),
                 angular=vector(0.0, 0.0, turn))
    return make(
        'nav_msgs/msg/Odometry', header=make_header(stamp_ns, 'odom'), child_frame_id=child,
        pose=make('geometry_msgs/msg/PoseWithCovariance', pose=make_pose(pose),
                  covariance=np.zeros(36)),
        twist=make('geometry_msgs/msg/TwistWithCovariance', twist=twist,
                   covariance=np.zeros(36)),
    )


def quaternion(x: float, y: float, z: float, w: float) -> Any:
    return make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w)


