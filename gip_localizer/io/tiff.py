# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The tags of a TIFF that OpenCV does not pass on: what its values mean, and which hold no data.

OpenCV decodes the pixels; GDAL's nodata value, the kind of extra bands and the sense of grey are
read here from the first directory of the file (TIFF 6.0 and BigTIFF).

"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
import struct
from typing import BinaryIO

BITS, PHOTOMETRIC, SAMPLES, EXTRA_SAMPLES, GDAL_NODATA = 258, 262, 277, 338, 42113
"""Numbers of tags: TIFF 6.0, and GDAL for the last."""
WHITE_IS_ZERO, PALETTE = 0, 3
"""Values of PhotometricInterpretation (TIFF 6.0)."""
UNSPECIFIED = 0
"""Value of ExtraSamples (TIFF 6.0) for an extra band that is not alpha."""
MOST_ENTRIES, MOST_BYTES = 4096, 4096
"""Most entries of a directory, and most bytes of an entry's value, that are read; chosen."""
FORMATS = {1: 'B', 2: 's', 3: 'H', 4: 'I', 16: 'Q'}
"""Type of an entry (TIFF 6.0, BigTIFF) → its format in `struct`."""


@dataclass(frozen=True)
class TiffTags:
    """
    What the first directory says.

    Attributes
    ----------
    samples, bits : int
        Bands, and bits of each.
    photometric : int
        0: the largest value is black; 3: values are numbers of a palette's colours.
    extra : tuple of int or None
        Kinds of the bands beyond grey or colour: 0 unspecified, 1 and 2 alpha; None: not said.
    nodata : float or None
        The stored value of cells without data.

    """

    samples: int = 1
    bits: int = 8
    photometric: int = 1
    extra: tuple[int, ...] | None = None
    nodata: float | None = None


def read_tiff_tags(path: Path) -> TiffTags | None:
    """Return the tags of a TIFF; None where the file is none or its directory is damaged."""
    with suppress(OSError, struct.error, ValueError, KeyError), path.open('rb') as stream:
        head = stream.read(16)
        order = {b'II': '<', b'MM': '>'}.get(head[:2])
        if order is None:
            return None
        version = struct.unpack(f'{order}H', head[2:4])[0]
        if version == 42:
            return _tags(_directory(stream, order, struct.unpack(f'{order}I', head[4:8])[0],
                                    count='H', entry='HHI4s', offset='I'))
        if version == 43:
            return _tags(_directory(stream, order, struct.unpack(f'{order}Q', head[8:16])[0],
                                    count='Q', entry='HHQ8s', offset='Q'))
    return None


Values = dict[int, tuple[int, ...] | bytes]


def _directory(stream: BinaryIO, order: str, start: int, *, count: str, entry: str,
               offset: str) -> Values:
    """Return the entries of a directory by tag; raises struct.error where it is cut off."""
    stream.seek(start)
    number = struct.unpack(order + count, stream.read(struct.calcsize(order + count)))[0]
    size = struct.calcsize(order + entry)
    raw = stream.read(size * min(number, MOST_ENTRIES))
    found: Values = {}
    for tag, kind, values, inline in struct.iter_unpack(order + entry, raw):
        letter = FORMATS.get(kind)
        length = struct.calcsize(f'{order}{values}{letter}') if letter else MOST_BYTES
        if length >= MOST_BYTES:
            continue
        if length > len(inline):
            stream.seek(struct.unpack(order + offset, inline)[0])
            inline = stream.read(length)
        unpacked = struct.unpack(f'{order}{values}{letter}', inline[:length])
        found[tag] = unpacked[0] if letter == 's' else unpacked
    return found


def _tags(values: Values) -> TiffTags:
    def number(tag: int, default: int) -> int:
        found = values.get(tag)
        return found[0] if isinstance(found, tuple) and found else default

    extra, nodata = values.get(EXTRA_SAMPLES), values.get(GDAL_NODATA)
    return TiffTags(
        number(SAMPLES, 1), number(BITS, 1), number(PHOTOMETRIC, 1),
        extra if isinstance(extra, tuple) else None,
        _nodata(nodata) if isinstance(nodata, bytes) else None,
    )


def _nodata(text: bytes) -> float | None:
    """Return GDAL's nodata value, which it writes as decimal text."""
    try:
        return float(text.split(b'\0')[0])
    except ValueError:
        return None
