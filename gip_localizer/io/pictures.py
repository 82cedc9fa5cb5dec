# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Picture files of maps and masks → grey values, and where they hold data."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
import re

import cv2
import numpy as np

from gip_localizer.core.arrays import Bools, Grey, WHITE
from gip_localizer.errors import MapError, shortened
from gip_localizer.io import jpeg
from gip_localizer.io.tiff import PALETTE, read_tiff_tags, TiffTags, UNSPECIFIED, WHITE_IS_ZERO

PNM = re.compile(rb'P([2356])(?:\s|#[^\n]*\n)+\d+(?:\s|#[^\n]*\n)+\d+(?:\s|#[^\n]*\n)+(\d+)\s')
PAM = re.compile(rb'P7\n.*?^MAXVAL\s+(\d+)$.*?^ENDHDR$', re.DOTALL | re.MULTILINE)
PNM_HEADER = 4096
"""Most bytes of the header of a PGM, PPM or PAM; chosen."""
PLAIN_PNM = (b'2', b'3')
"""Kinds of PNM written as text, whose values up to 255 OpenCV scales itself."""
ALPHA_SHARE = 0.5
"""Least share (no unit) of 0 and full scale for using a fourth band of unknown kind as alpha;
chosen: a mask has few other values, near infrared has many."""
Decoded = tuple[Grey, Bools | None]


def read_picture(what: str, path: Path) -> Decoded:
    """
    Read a picture of 8 or 16 bits.

    Parameters
    ----------
    what : str
        Names the picture in messages.
    path : Path
        JPEG, PNG, PGM, TIFF, or whatever else OpenCV reads.

    Returns
    -------
    grey : (rows, cols) uint8 or uint16
        At the full scale of its type where the file says what its largest value is.
    valid : (rows, cols) bool or None
        False where alpha is 0, or all bands hold the TIFF's nodata value; None: valid all over.

    Raises
    ------
    MapError
        Missing, unreadable, damaged, or bands that are not understood.

    """
    check_is_file(what, path)
    tags = read_tiff_tags(path)
    if tags is not None:
        _check_bands(what, tags)
    pixels = _pixels(what, path)
    if tags is None:
        return _grey_and_alpha(_scaled_pnm(path, pixels), alpha=True)
    return _tiff_cells(what, pixels, tags)


def check_is_file(what: str, path: Path) -> None:
    """Refuse what is no file (raises MapError)."""
    try:
        found, is_folder = path.is_file(), path.is_dir()
    except OSError as error:
        raise MapError(f'{what} cannot be read ({error.strerror})') from None
    if not found:
        raise MapError(f'{what} {"is a folder" if is_folder else "does not exist"}')


def _pixels(what: str, path: Path) -> Grey:
    """Return what a picture holds, in all its channels."""
    with path.open('rb') as stream:
        start = stream.read(len(jpeg.START))
    if jpeg.is_jpeg(start):
        return _jpeg_pixels(what, path.read_bytes())
    with _quiet_opencv():
        try:
            pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        except (cv2.error, MemoryError) as error:
            why = shortened(getattr(error, 'err', '') or str(error))
            raise MapError(
                f'{what} cannot be read ({why}); expected a whole image that fits into memory, '
                'of at most 2^30 pixels'
            ) from None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise MapError(
            f'{what} cannot be read; expected a whole 8 or 16 bit image, for example PNG or PGM'
        )
    return np.asarray(pixels)


def _jpeg_pixels(what: str, content: bytes) -> Grey:
    end = jpeg.end_of(content)
    if end is None:
        raise MapError(f'{what} is cut off; copy it again')
    pixels, damaged = jpeg.decode_jpeg(content[:end])
    if pixels is None:
        raise MapError(f'{what} is damaged ({damaged or "no picture in it"}); copy it again')
    return pixels


@contextmanager
def _quiet_opencv() -> Iterator[None]:
    """Keep OpenCV from logging: what it cannot read is an error of ours, unknown tags are none."""
    log = getattr(getattr(cv2, 'utils', None), 'logging', None)
    if log is None:
        yield
        return
    before = log.setLogLevel(log.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        log.setLogLevel(before)


def _scaled_pnm(path: Path, pixels: Grey) -> Grey:
    """Scale the values of a PGM, PPM or PAM by the largest that its header allows."""
    with path.open('rb') as stream:
        header = stream.read(PNM_HEADER)
    found, pam = PNM.match(header), PAM.match(header)
    if pam is not None:
        largest = int(pam[1])
    elif found is not None and (int(found[2]) > 255 or found[1] not in PLAIN_PNM):
        largest = int(found[2])
    else:
        return pixels
    full = int(WHITE[pixels.dtype])
    if not 0 < largest < full:
        return pixels
    levels = np.minimum(np.arange(full + 1) * (full / largest), full)
    return np.round(levels).astype(pixels.dtype)[pixels]


def _check_bands(what: str, tags: TiffTags) -> None:
    if tags.samples not in (1, 3, 4):
        raise MapError(
            f'{what} has {tags.samples} bands; expected grey, three colours, or those and alpha; '
            'choose one with: gdal_translate -b 1'
        )
    if tags.photometric == PALETTE and tags.nodata is not None:
        raise MapError(
            f'{what} has a nodata value and a palette, of which only the colours are read; '
            'expand it with: gdal_translate -expand gray'
        )


def _tiff_cells(what: str, pixels: Grey, tags: TiffTags) -> Decoded:
    if tags.photometric == WHITE_IS_ZERO and pixels.dtype == np.uint16:
        pixels = np.iinfo(np.uint16).max - pixels  # OpenCV inverts 8 bits only
    alpha = pixels.ndim == 3 and pixels.shape[2] == 4 and _has_alpha(pixels, tags)
    grey, valid = _grey_and_alpha(pixels, alpha=alpha)
    nodata = _stored_nodata(pixels, tags)
    if nodata is None:
        return grey, valid
    bands = pixels.reshape(*pixels.shape[:2], -1)[:, :, :3]
    known = (bands != nodata).any(axis=2)
    if valid is not None:
        known &= valid
    return grey, None if known.all() else known


def _has_alpha(pixels: Grey, tags: TiffTags) -> bool:
    """Return whether the fourth band of a TIFF is alpha."""
    if tags.extra:
        return tags.extra[0] != UNSPECIFIED
    band = pixels[:, :, 3]
    return float(np.mean((band == 0) | (band == WHITE[band.dtype]))) >= ALPHA_SHARE


def _stored_nodata(pixels: Grey, tags: TiffTags) -> int | None:
    """Return the value of cells without data as decoded; None where no cell can hold it."""
    full = int(WHITE[pixels.dtype])
    if tags.nodata is None or not tags.nodata.is_integer() or not 0 <= tags.nodata <= full:
        return None
    value = int(tags.nodata)
    return full - value if tags.photometric == WHITE_IS_ZERO else value


def _grey_and_alpha(pixels: Grey, *, alpha: bool) -> Decoded:
    if pixels.ndim == 2:
        return pixels, None
    valid = None
    if alpha and pixels.shape[2] in (2, 4):
        valid = pixels[:, :, -1] > 0
    if pixels.shape[2] >= 3:
        grey = cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_BGR2GRAY)
    else:
        grey = np.ascontiguousarray(pixels[:, :, 0])
    return np.asarray(grey), None if valid is None or valid.all() else valid
