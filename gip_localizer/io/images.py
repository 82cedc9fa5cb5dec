# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Image messages → grey arrays, without cv_bridge and without copies where none is needed.

Duck-typed: rclpy messages (`array.array`) and rosbags messages (`ndarray`) both pass.

"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Grey
from gip_localizer.errors import ImageError
from gip_localizer.io.jpeg_warnings import damage, decoder_warnings

MAX_PIXELS = 1 << 27  # a larger image is a fault or an attack, not a camera
COLOUR = {
    'rgb8': cv2.COLOR_RGB2GRAY,
    'bgr8': cv2.COLOR_BGR2GRAY,
    'rgba8': cv2.COLOR_RGBA2GRAY,
    'bgra8': cv2.COLOR_BGRA2GRAY,
}
# OpenCV names a Bayer pattern by its second row's second and third pixel
BAYER = {
    'bayer_rggb8': cv2.COLOR_BayerBG2GRAY,
    'bayer_bggr8': cv2.COLOR_BayerRG2GRAY,
    'bayer_gbrg8': cv2.COLOR_BayerGR2GRAY,
    'bayer_grbg8': cv2.COLOR_BayerGB2GRAY,
}
# encoding → channels, bytes per channel
LAYOUTS = {
    'mono8': (1, 1), '8UC1': (1, 1), 'mono16': (1, 2), '16UC1': (1, 2),
    '8UC3': (3, 1), '8UC4': (4, 1),
    **{name: (4 if 'a' in name else 3, 1) for name in COLOUR},
    **{name: (1, 1) for name in BAYER},
    'yuv422': (2, 1), 'uyvy': (2, 1), 'yuv422_yuy2': (2, 1), 'yuyv': (2, 1),
}


def grey_image(message: Any) -> Grey:
    """
    Return the grey image of a sensor_msgs/Image.

    Parameters
    ----------
    message : sensor_msgs/Image
        Any of the encodings in `LAYOUTS`; `step` and `is_bigendian` are honoured.

    Returns
    -------
    (height, width) uint8 or uint16
        A view of the message's data where no conversion is needed.

    Raises
    ------
    ImageError
        Unknown encoding, zero or absurd size, a step shorter than a row, or missing data.

    """
    encoding = str(message.encoding)
    if encoding not in LAYOUTS:
        raise ImageError(
            f'image encoding {encoding!r} is not supported; expected one of '
            + ', '.join(sorted(LAYOUTS))
        )
    channels, size = LAYOUTS[encoding]
    pixels = _rows(message, channels * size)
    if size == 2:
        order = '>u2' if message.is_bigendian else '<u2'
        wide = np.ascontiguousarray(pixels).view(order).reshape(pixels.shape[0], -1)
        return wide.astype(np.uint16, copy=False)
    if encoding in BAYER:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), BAYER[encoding]))
    if encoding in ('yuv422', 'uyvy'):
        return pixels[:, 1::2]
    if encoding in ('yuv422_yuy2', 'yuyv'):
        return pixels[:, 0::2]
    if channels == 1:
        return pixels
    colour = {3: 'bgr8', 4: 'bgra8'}[channels] if encoding not in COLOUR else encoding
    shaped = np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1, channels)
    return np.asarray(cv2.cvtColor(shaped, COLOUR[colour]))


def _rows(message: Any, bytes_per_pixel: int) -> Grey:
    """Return the message's rows without padding, (height, width * bytes_per_pixel) uint8."""
    height, width, step = int(message.height), int(message.width), int(message.step)
    if height < 1 or width < 1 or height * width > MAX_PIXELS:
        raise ImageError(f'image size is {width}x{height}; expected 1 to {MAX_PIXELS} pixels')
    row = width * bytes_per_pixel
    if step < row:
        raise ImageError(
            f'image step is {step} bytes; a row of {width} {message.encoding} pixels takes {row}'
        )
    data = np.frombuffer(message.data, np.uint8)
    needed = step * (height - 1) + row
    if data.size < needed:
        raise ImageError(
            f'image holds {data.size} bytes; {height} rows of step {step} take {needed}'
        )
    if data.size < step * height:
        data = np.concatenate([data, np.zeros(step * height - data.size, np.uint8)])
    return data[: step * height].reshape(height, step)[:, :row]


def compressed_grey_image(message: Any) -> Grey:
    """
    Return the grey image of a sensor_msgs/CompressedImage (jpeg or png, 8 or 16 bit).

    Raises
    ------
    ImageError
        Empty, corrupt, cut off, too large or of another format.

    """
    data = np.frombuffer(message.data, np.uint8)
    content = data.tobytes()
    size = _declared_size(content)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise ImageError(f'compressed image declares {size[0]}x{size[1]} pixels; too large')
    pixels, damaged = _decoded(data) if size is not None else (None, '')
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f'compressed image of {data.size} bytes and format {str(message.format)!r} cannot be '
            'decoded; expected a whole jpeg or png'
        )
    if is_truncated_jpeg(content):
        raise ImageError(f'jpeg image of {data.size} bytes is truncated')
    if damaged:
        raise ImageError(f'compressed image of {data.size} bytes is damaged: {damaged}')
    return pixels


def _decoded(data: NDArray[np.uint8]) -> tuple[Grey | None, str]:
    """Return the pixels, None where there are none, and what the decoder says of damage."""
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    with decoder_warnings() as warnings:
        try:
            pixels = cv2.imdecode(data, flags)
        except cv2.error:
            pixels = None
    return (None if pixels is None else np.asarray(pixels)), damage(warnings)


JPEG_START, JPEG_END, PNG_START = b'\xff\xd8', b'\xff\xd9', b'\x89PNG\r\n\x1a\n'
JPEG_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # segments that declare the size


def is_truncated_jpeg(content: bytes) -> bool:
    """Tell whether it is a JPEG without its end, which OpenCV fills with grey in silence."""
    return content[:2] == JPEG_START and JPEG_END not in content[-64:]


def _declared_size(content: bytes) -> tuple[int, int] | None:
    """Width and height in the header of a PNG or JPEG; None where there is none."""
    if content[:8] == PNG_START and len(content) >= 24:
        return int.from_bytes(content[16:20], 'big'), int.from_bytes(content[20:24], 'big')
    place = 2
    while content[:2] == JPEG_START and content[place : place + 1] == b'\xff':
        kind = content[place + 1 : place + 2]
        if kind and kind[0] in JPEG_FRAMES:
            rows, cols = content[place + 5 : place + 7], content[place + 7 : place + 9]
            return int.from_bytes(cols, 'big'), int.from_bytes(rows, 'big')
        length = int.from_bytes(content[place + 2 : place + 4], 'big')
        place += 1 if kind == b'\xff' else 2 + max(length, 2)
    return None
