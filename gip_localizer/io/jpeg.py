# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
JPEG images: detection of their end and of damage.

For damaged data libjpeg only warns: it fills the missing part with grey or with the previous data,
and such an image can match a wrong place. `simplejpeg` raises these warnings as errors. Without it
(no Debian package exists) OpenCV decodes, and only images without an end are recognized as
damaged.

"""

from __future__ import annotations

import re

import cv2
import numpy as np

from gip_localizer.core.arrays import Grey

try:
    import simplejpeg
except ImportError:
    simplejpeg = None

START = b'\xff\xd8'
LONE, BEGINS, ENDS, SCAN = {0x01, *range(0xD0, 0xD8)}, 0xD8, 0xD9, 0xDA
"""Markers (ITU-T T.81) without a length; of start and end of an image; of a scan, which is
followed by compressed data."""
FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}
"""Markers of the segments that declare the size: SOF0 to SOF15 of ITU-T T.81."""
MARKER = re.compile(rb'\xff+([\x01-\xcf\xd8-\xfe])')
"""Any marker that ends compressed data: no stuffed 0xff and no restart (0xd0 to 0xd7)."""
EXTRANEOUS = re.compile(r'(\d+) extraneous bytes')
STUFFED = 8
"""Most extraneous bytes in an undamaged image; chosen: some cameras leave a few."""
HARMLESS = 'JFIF'
"""Text in libjpeg's warnings of an unknown JFIF version, which are ignored."""


def is_jpeg(content: bytes) -> bool:
    """Whether data begin like a JPEG."""
    return content[:2] == START


def declared_size(content: bytes) -> tuple[int, int] | None:
    """Return width and height from the header of a JPEG; None if it has none."""
    for kind, place in _segments(content):
        if kind in FRAMES:
            rows, cols = content[place + 3 : place + 5], content[place + 5 : place + 7]
            return int.from_bytes(cols, 'big'), int.from_bytes(rows, 'big')
    return None


def end_of(content: bytes) -> int | None:
    """
    Return the number of bytes up to the end marker of a JPEG; None where it has none.

    Segments are passed over by their length, so that the thumbnail in one ends nothing; whatever
    follows the end belongs to no picture.

    """
    for kind, place in _segments(content):
        if kind == ENDS:
            return place
    return None


def _segments(content: bytes) -> list[tuple[int, int]]:
    """Return (marker, place behind it) of each segment, as far as they follow each other."""
    found: list[tuple[int, int]] = []
    place = 2
    while (marker := MARKER.match(content, place)) is not None:
        kind, place = marker[1][0], marker.end()
        if kind == BEGINS:  # of another picture, before this one has ended
            break
        found.append((kind, place))
        if kind == ENDS:
            break
        if kind not in LONE:
            place += max(int.from_bytes(content[place : place + 2], 'big'), 2)
        if kind == SCAN:
            following = MARKER.search(content, place)
            if following is None:
                break
            place = following.start()
    return found


def decode_jpeg(content: bytes) -> tuple[Grey | None, str]:
    """
    Decode a JPEG that has its end.

    Parameters
    ----------
    content : bytes
        From its start to its end marker.

    Returns
    -------
    (height, width) uint8, or None
        Grey; None where nothing can be decoded.
    str
        What is damaged; empty where the picture is whole.

    """
    if simplejpeg is None:
        flags = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
        pixels = cv2.imdecode(np.frombuffer(content, np.uint8), flags)
        return (None if pixels is None else np.asarray(pixels)), ''
    try:
        return simplejpeg.decode_jpeg(content, 'GRAY')[:, :, 0], ''
    except ValueError as error:
        warning = str(error)
    if not _harmless(warning):
        return None, warning
    try:
        return simplejpeg.decode_jpeg(content, 'GRAY', strict=False)[:, :, 0], ''
    except ValueError as error:
        return None, str(error)


def _harmless(warning: str) -> bool:
    extraneous = EXTRANEOUS.search(warning)
    if extraneous is not None:
        return int(extraneous[1]) <= STUFFED
    return HARMLESS in warning
