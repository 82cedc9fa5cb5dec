# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages of a camera: image, calibration and mounting pose."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gip_localizer.core.arrays import Grey
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.io.bags.writer import make, make_header

OPTICAL = 'camera_optical_frame'
IMAGE_TYPE, COMPRESSED_TYPE = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage'
INFO_TYPE, TF_TYPE = 'sensor_msgs/msg/CameraInfo', 'tf2_msgs/msg/TFMessage'


def image_message(header: Any, image: Grey) -> Any:
    """Return a sensor_msgs/Image of a (rows, cols) uint8 or uint16 picture."""
    rows, cols = image.shape
    little = image.astype(image.dtype.newbyteorder('<'))
    return make(
        IMAGE_TYPE, header=header, height=rows, width=cols, encoding=_encoding(image),
        is_bigendian=0, step=cols * image.itemsize,
        data=np.frombuffer(little.tobytes(), np.uint8),
    )


def compressed_message(header: Any, image: Grey, kind: str, quality: int) -> Any:
    """Return a sensor_msgs/CompressedImage; kind is jpeg (quality 1 to 100) or png."""
    options = [cv2.IMWRITE_JPEG_QUALITY, quality] if kind == 'jpeg' else []
    _, encoded = cv2.imencode('.jpg' if kind == 'jpeg' else '.png', image, options)
    depth = _encoding(image)
    return make(COMPRESSED_TYPE, header=header, data=encoded.ravel(),
                format=f'{depth}; {kind} compressed {depth}')


def _encoding(image: Grey) -> str:
    return 'mono8' if image.itemsize == 1 else 'mono16'


def info_message(header: Any, numbers: Calibration) -> Any:
    """Return the sensor_msgs/CameraInfo of a calibration."""
    x, y, width, height = numbers.roi
    projection = np.hstack([numbers.P, np.zeros((3, 1))])
    binning = [0 if count == 1 else count for count in numbers.binning]
    return make(
        INFO_TYPE, header=header, height=numbers.height, width=numbers.width,
        distortion_model=numbers.model, d=numbers.D.astype(float), k=numbers.K.ravel(),
        r=numbers.R.ravel(), p=projection.ravel(), binning_x=binning[0], binning_y=binning[1],
        roi=make('sensor_msgs/msg/RegionOfInterest', x_offset=x, y_offset=y, width=width,
                 height=height, do_rectify=False),
    )


def mounting_message(stamp_ns: int, base: str, held: Extrinsics) -> Any:
    """Return a tf2_msgs/TFMessage with the pose of the camera's optical frame in the base."""
    x, y, z, w = (float(value) for value in Rotation.from_matrix(held.rotation()).as_quat())
    transform = make(
        'geometry_msgs/msg/Transform',
        translation=make('geometry_msgs/msg/Vector3', x=held.x, y=held.y, z=held.z),
        rotation=make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
    )
    stamped = make('geometry_msgs/msg/TransformStamped', header=make_header(stamp_ns, base),
                   child_frame_id=OPTICAL, transform=transform)
    return make(TF_TYPE, transforms=[stamped])
