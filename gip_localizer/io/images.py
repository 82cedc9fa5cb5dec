# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Image messages → grey arrays, without cv_bridge and without copies where none is needed.

Duck-typed: rclpy messages (`array.array`) and rosbags messages (`ndarray`) both pass.

"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.errors import ImageError, quoted
from gip_localizer.io import jpeg

MAX_PIXELS = 1 << 27
"""Largest number of pixels of an image (134 megapixels); chosen above any camera."""
COLOUR = {
    f'{order}{bits}': code
    for bits in (8, 16)
    for order, code in (
        ('rgb', cv2.COLOR_RGB2GRAY), ('bgr', cv2.COLOR_BGR2GRAY),
        ('rgba', cv2.COLOR_RGBA2GRAY), ('bgra', cv2.COLOR_BGRA2GRAY),
    )
}
# OpenCV names a Bayer pattern by its second row's second and third pixel
BAYER = {
    f'bayer_{pattern}{bits}': code
    for bits in (8, 16)
    for pattern, code in (
        ('rggb', cv2.COLOR_BayerBG2GRAY), ('bggr', cv2.COLOR_BayerRG2GRAY),
        ('gbrg', cv2.COLOR_BayerGR2GRAY), ('grbg', cv2.COLOR_BayerGB2GRAY),
    )
}
CHROMA_ROWS = {'nv12': 1, 'nv21': 1, 'nv24': 4}
"""Encoding with luminance first → rows of colour bytes per two rows of luminance (no unit)."""
# encoding → channels, bytes per channel
LAYOUTS = {
    'mono8': (1, 1), '8UC1': (1, 1), 'mono16': (1, 2), '16UC1': (1, 2),
    '8UC3': (3, 1), '8UC4': (4, 1), '16UC3': (3, 2), '16UC4': (4, 2),
    **{name: (4 if 'a' in name else 3, 1 + name.endswith('16')) for name in COLOUR},
    **{name: (1, 1 + name.endswith('16')) for name in BAYER},
    'yuv422': (2, 1), 'uyvy': (2, 1), 'yuv422_yuy2': (2, 1), 'yuyv': (2, 1),
    **{name: (1, 1) for name in CHROMA_ROWS},
}
UNNAMED = {'8UC3': 'bgr8', '8UC4': 'bgra8', '16UC3': 'bgr16', '16UC4': 'bgra16'}
"""Encoding without named channels → assumed encoding: the channel order of OpenCV."""


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
            f'image encoding {quoted(encoding)} is not supported; expected one of '
            + ', '.join(sorted(LAYOUTS))
        )
    channels, size = LAYOUTS[encoding]
    pixels = _rows(message, channels * size)
    if size == 2:
        order = '>u2' if message.is_bigendian else '<u2'
        wide = np.ascontiguousarray(pixels).view(order).reshape(pixels.shape[0], -1)
        pixels = wide.astype(np.uint16, copy=False)
    if encoding in BAYER:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), BAYER[encoding]))
    if encoding in ('yuv422', 'uyvy'):
        return pixels[:, 1::2]
    if encoding in ('yuv422_yuy2', 'yuyv'):
        return pixels[:, 0::2]
    if channels == 1:
        return pixels
    shaped = np.ascontiguousarray(pixels).reshape(pixels.shape[0], -1, channels)
    return np.asarray(cv2.cvtColor(shaped, COLOUR[UNNAMED.get(encoding, encoding)]))


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
    needed = step * (height - 1) + row + step * _chroma_rows(message.encoding, height)
    if data.size < needed:
        raise ImageError(
            f'image holds {data.size} bytes; {height} rows of step {step} take {needed}'
            + _suspicion(bytes(data[:8]))
        )
    if data.size < step * height:
        data = np.concatenate([data, np.zeros(step * height - data.size, np.uint8)])
    return data[: step * height].reshape(height, step)[:, :row]


def _suspicion(begin: bytes) -> str:
    """Return a hint if the bytes of an Image are a compressed file, as some drivers send."""
    for kind, signature in (('JPEG', b'\xff\xd8\xff'), ('PNG', b'\x89PNG')):
        if begin.startswith(signature):
            return (f'; they begin like a {kind} file: publish them as '
                    'sensor_msgs/CompressedImage, and set image_transport: compressed')
    return ''


def _chroma_rows(encoding: str, height: int) -> int:
    """Return the number of rows of colour after those of luminance."""
    return (CHROMA_ROWS.get(encoding, 0) * height + 1) // 2


@dataclass(frozen=True)
class DecodedImage:
    """
    An image of a video, which only its stream can decode.

    Attributes
    ----------
    header : std_msgs/Header
        Of the message.
    pixels : (height, width) array or None
        None where it cannot be used.
    fault : str
        Why.

    """

    header: Any
    pixels: Grey | None
    fault: str = ''


def compressed_grey_image(message: Any) -> Grey:
    """
    Return the grey image of a sensor_msgs/CompressedImage (jpeg or png, 8 or 16 bit).

    Of a video, the message is a `DecodedImage` (`image_stream`).

    Raises
    ------
    ImageError
        Empty, corrupt, cut off, too large or of another format.

    """
    if not isinstance(message, DecodedImage):
        return _decoded_file(bytes(message.data), str(message.format))
    if message.pixels is None:
        raise ImageError(message.fault)
    return message.pixels


def _decoded_file(content: bytes, form: str) -> Grey:
    size = _declared_size(content)
    if size is not None and size[0] * size[1] > MAX_PIXELS:
        raise ImageError(f'compressed image declares {size[0]}x{size[1]} pixels; too large')
    pixels, damaged = None, ''
    if size is not None and jpeg.is_jpeg(content):
        end = jpeg.end_of(content)
        if end is None:
            raise ImageError(f'jpeg image of {len(content)} bytes is truncated')
        pixels, damaged = jpeg.decode_jpeg(content[:end])
    elif size is not None:
        pixels = _decoded_png(content)
    if damaged:
        raise ImageError(f'compressed image of {len(content)} bytes is damaged: {damaged}')
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise ImageError(
            f'compressed image of {len(content)} bytes and format {quoted(form)} '
            'cannot be decoded; expected a whole jpeg or png, or h264 or h265'
        )
    return pixels


def _decoded_png(content: bytes) -> Grey | None:
    flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
    except cv2.error:
        return None
    return None if pixels is None else np.asarray(pixels)


PNG_START = b'\x89PNG\r\n\x1a\n'


def _declared_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height from the header of a PNG or JPEG; None if it has none."""
    if content[:8] == PNG_START and len(content) >= 24:
        return int.from_bytes(content[16:20], 'big'), int.from_bytes(content[20:24], 'big')
    return jpeg.declared_size(content) if jpeg.is_jpeg(content) else None
