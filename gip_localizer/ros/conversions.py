# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Results as ROS messages.

Sequences are given as `array.array`: anything else is checked element by element by rclpy.

"""

from __future__ import annotations

from array import array
import math
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
import cv2
from geometry_msgs.msg import Pose, PoseStamped, PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_msgs.msg import Header

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import Pose2
from gip_localizer.io.messages import full_covariance
from gip_localizer.session.attitude import Tilt

if TYPE_CHECKING:  # the localizer needs no simulator
    from gip_localizer.synthetic.wheel_odometry import OdometryReading

NS = 1_000_000_000
"""Nanoseconds per second."""
LEVEL = Tilt()
MAX_GRID_CELLS = 4_000_000
"""Largest number of cells of the OccupancyGrid; chosen: larger maps get coarser cells."""
STRIP_ROWS = 64
"""Number of rows of the grid that are computed at once; chosen, to bound the memory."""
NO_DATA = -1
"""Occupancy of unknown cells: nav_msgs/OccupancyGrid."""


def time_of(stamp_ns: int) -> Time:
    """Return nanoseconds since the epoch as a message."""
    return Time(sec=stamp_ns // NS, nanosec=stamp_ns % NS)


def header_of(stamp_ns: int, frame: str) -> Header:
    """Return a header of a stamp and a frame."""
    return Header(stamp=time_of(stamp_ns), frame_id=frame)


def pose_of(pose: Pose2, tilt: Tilt = LEVEL) -> Pose:
    """Return a planar pose; by default z, roll and pitch are 0."""
    message = Pose()
    at, orientation = message.position, message.orientation
    at.x, at.y, at.z = float(pose.x), float(pose.y), tilt.z
    orientation.x, orientation.y, orientation.z, orientation.w = tilt.quaternion(pose.yaw)
    return message


def pose_stamped(stamp_ns: int, frame: str, pose: Pose2, tilt: Tilt = LEVEL) -> PoseStamped:
    """Return a pose with its header."""
    return PoseStamped(header=header_of(stamp_ns, frame), pose=pose_of(pose, tilt))


def pose_with_covariance(
    posed: PoseStamped, covariance: NDArray[np.floating]
) -> PoseWithCovarianceStamped:
    """
    Return a pose with its uncertainty.

    Parameters
    ----------
    posed : PoseStamped
        Header and pose.
    covariance : (36,) float64
        Row-major, of x, y, z [m], roll, pitch, yaw [rad].

    """
    message = PoseWithCovarianceStamped(header=posed.header)
    message.pose.pose = posed.pose
    message.pose.covariance = covariance
    return message


def mono8(stamp_ns: int, frame: str, pixels: NDArray[np.uint8]) -> Image:
    """Return a grey picture (h, w) as a message."""
    return _image(stamp_ns, frame, pixels, 'mono8')


def bgr8(stamp_ns: int, frame: str, pixels: NDArray[np.uint8]) -> Image:
    """Return a colour picture (h, w, 3), blue first, as a message."""
    return _image(stamp_ns, frame, pixels, 'bgr8')


def mono16(stamp_ns: int, frame: str, pixels: NDArray[np.uint16]) -> Image:
    """Return a 16 bit grey picture (h, w) as a message."""
    return _image(stamp_ns, frame, pixels, 'mono16')


def _image(stamp_ns: int, frame: str, pixels: NDArray[np.generic], encoding: str) -> Image:
    little = np.ascontiguousarray(pixels, pixels.dtype.newbyteorder('<'))
    return Image(
        header=header_of(stamp_ns, frame),
        height=little.shape[0], width=little.shape[1], encoding=encoding, is_bigendian=0,
        step=little.strides[0], data=array('B', little.tobytes()),
    )  # fmt: skip


def jpeg(
    stamp_ns: int, frame: str, pixels: NDArray[np.unsignedinteger], quality: int
) -> CompressedImage:
    """Return a grey picture (h, w), 8 or 16 bit, as JPEG (its upper 8 bits)."""
    if pixels.dtype != np.uint8:
        pixels = (pixels >> 8).astype(np.uint8)
    _, encoded = cv2.imencode('.jpg', pixels, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return CompressedImage(
        header=header_of(stamp_ns, frame), format='mono8; jpeg compressed mono8',
        data=array('B', encoded.tobytes()),
    )  # fmt: skip


def camera_info(stamp_ns: int, frame: str, calibration: Calibration) -> CameraInfo:
    """Return a calibration as a message."""
    info = CameraInfo(
        header=header_of(stamp_ns, frame), width=calibration.width, height=calibration.height,
        distortion_model=calibration.model, d=array('d', calibration.D.astype(float)),
        binning_x=calibration.binning[0], binning_y=calibration.binning[1],
    )  # fmt: skip
    info.k, info.r = calibration.K.ravel(), calibration.R.ravel()
    info.p = np.hstack([calibration.P, np.zeros((3, 1))]).ravel()
    roi = info.roi
    roi.x_offset, roi.y_offset, roi.width, roi.height = calibration.roi
    return info


def odometry_of(stamp_ns: int, frame: str, base: str, reading: OdometryReading) -> Odometry:
    """Return a sample of the wheel odometry as a message with its own stamp."""
    sample = reading.sample
    message = Odometry(header=header_of(stamp_ns, frame), child_frame_id=base)
    message.pose.pose = pose_of(sample.pose)
    message.pose.covariance = full_covariance(reading.pose_covariance)
    twist = message.twist.twist
    twist.linear.x, twist.linear.y = sample.forward, sample.left
    twist.angular.z = sample.turn
    message.twist.covariance = full_covariance(reading.twist_covariance)
    return message


def occupancy_grid(stamp_ns: int, frame: str, raster_map: RasterMap) -> OccupancyGrid:
    """Return a map for RViz: black is 100, white is 0, no data is -1."""
    factor = max(1, math.ceil(math.sqrt(raster_map.grey.size / MAX_GRID_CELLS)))
    cells = _occupancy(raster_map, factor)
    grid = OccupancyGrid(header=header_of(stamp_ns, frame))
    grid.info.resolution = raster_map.resolution * factor
    grid.info.height, grid.info.width = cells.shape
    grid.info.origin = pose_of(raster_map.origin)
    grid.data = array('b', np.flipud(cells).tobytes())
    return grid


def _occupancy(raster_map: RasterMap, factor: int) -> NDArray[np.int8]:
    """Return (rows, cols) occupancy, top row first, joined from `factor` squared cells."""
    rows, cols = (max(size // factor, 1) for size in raster_map.grey.shape)
    # The origin is the lower-left corner: what does not fill a cell is cut at the top and right.
    top = max(raster_map.grey.shape[0] - rows * factor, 0)
    cells = np.empty((rows, cols), np.int8)
    for start in range(0, rows, STRIP_ROWS):  # a large map is never held as floats
        strip = slice(start, min(start + STRIP_ROWS, rows))
        part = (slice(top + strip.start * factor, top + strip.stop * factor),
                slice(0, cols * factor))
        valid = None if raster_map.valid is None else raster_map.valid[part]
        grey = on_unit_scale(raster_map.grey[part])
        cells[strip] = _occupancy_of(grey, valid, (cols, strip.stop - strip.start))
    raster_map.release()
    return cells


def _occupancy_of(
    grey: NDArray[np.float32], valid: NDArray[np.bool_] | None, size: tuple[int, int]
) -> NDArray[np.int8]:
    """Return the occupancy of a part of the map, joined into `size` columns and rows."""
    known = np.ones(grey.shape, np.float32) if valid is None else valid.astype(np.float32)
    if grey.shape != size[::-1]:
        grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        known = cv2.resize(known, size, interpolation=cv2.INTER_AREA)
    occupancy = np.round(100.0 * (1.0 - np.clip(grey, 0.0, 1.0)))
    return np.where(known > 0.5, occupancy, NO_DATA).astype(np.int8)
