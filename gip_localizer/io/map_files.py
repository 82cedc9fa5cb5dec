# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps on disk: a nav2 map_server YAML beside an image (8 or 16 bit, alpha 0 is no data)."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from gip_localizer.core.arrays import Bools, Grey, WHITE
from gip_localizer.core.birdseye.rectifier import LOOKED_AT
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError, OutputError
from gip_localizer.io.images import is_truncated_jpeg
from gip_localizer.io.jpeg_warnings import damage, decoder_warnings
from gip_localizer.io.map_cache import Cells, stored_cells
from gip_localizer.io.output_folder import write_whole

REQUIRED = ('image', 'resolution', 'origin')
MODES = ('trinary', 'scale', 'raw')  # of nav2: how grey becomes occupancy, which is not asked here
FINEST, COARSEST = 1e-4, 100.0  # metres per cell: beyond are other units


def load_map(path: Path | str) -> RasterMap:
    """
    Read a map YAML and its image.

    Parameters
    ----------
    path : Path or str
        The YAML file; the image's path in it is relative to the file.

    Returns
    -------
    RasterMap
        At the image's full depth; inverted when `negate` is 1. Large maps are read-only, and
        mapped from disk (`map_store`). Where the YAML names another image as `noise`, it holds
        the standard deviation of each cell, on the scale of its own depth.

    Raises
    ------
    MapError
        Missing or unreadable file, missing key, wrong type, a resolution that no road map has, or
        nothing but transparency.

    """
    path = Path(path)
    settings = _settings(path)
    resolution = _number(path, 'resolution', settings['resolution'])
    if not FINEST <= resolution <= COARSEST:
        raise MapError(
            f'map {path}: resolution is {resolution:g}; expected metres per cell, '
            f'{FINEST:g} to {COARSEST:g}'
        )
    origin = settings['origin']
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f'map {path}: origin is {origin!r}; expected [x, y, yaw]')
    x, y, yaw = (_number(path, 'origin', value) for value in origin)
    negate = settings.get('negate', 0)
    if negate not in (0, 1, False, True):
        raise MapError(f'map {path}: negate is {negate!r}; expected 0 or 1')
    if settings.get('mode', MODES[0]) not in MODES:
        raise MapError(f'map {path}: mode is {settings["mode"]!r}; expected {", ".join(MODES)}')
    grey, valid = _cells(path, settings, 'image', negate=bool(negate))
    if valid is not None and not valid.any():
        raise MapError(f'map {path}: its image is transparent all over; expected road to be seen')
    noise = None
    if settings.get('noise') is not None:
        noise, _ = _cells(path, settings, 'noise', negate=False)
        if noise.shape != grey.shape:
            raise MapError(
                f'map {path}: its noise has {noise.shape[1]}x{noise.shape[0]} cells, its image '
                f'{grey.shape[1]}x{grey.shape[0]}; expected the same'
            )
    return RasterMap(grey, resolution, Pose2(x, y, yaw), valid, noise)


def _cells(path: Path, settings: Mapping[str, Any], key: str, *, negate: bool) -> Cells:
    """Return the cells of the picture that a key names."""
    if not isinstance(settings[key], str):
        raise MapError(f'map {path}: {key} is {settings[key]!r}; expected a file name')
    image = path.parent / settings[key]
    what = f'map {path}: its {key} {image}'
    _check_is_file(what, image)

    def decode() -> Cells:
        grey, valid = _read_image(what, image)
        return (WHITE[grey.dtype] - grey).astype(grey.dtype) if negate else grey, valid

    return stored_cells(image, 'negated' if negate else 'as-is', decode)


def load_mask(path: Path | str) -> Grey:
    """
    Read the picture of what the camera always sees of its own vehicle.

    Parameters
    ----------
    path : Path or str
        An 8 bit image of the camera's size: white is looked at, black is not.

    Returns
    -------
    (height, width) uint8
        Pixels below 128 are masked.

    Raises
    ------
    MapError
        Missing, unreadable, not 8 bit, or black all over.

    """
    what = f'mask_file {path}'
    grey, _ = _read_image(what, Path(path))
    if grey.dtype != np.uint8:
        raise MapError(f'{what} has 16 bits a pixel; expected 8')
    if grey.max() < LOOKED_AT:
        raise MapError(
            f'{what} is black all over (largest value {grey.max()}), so that nothing would be '
            'looked at; expected 255, and black only where the camera sees its own vehicle'
        )
    return np.ascontiguousarray(grey)


def save_map(raster_map: RasterMap, path: Path | str, *, force: bool = False) -> None:
    """
    Write a map as YAML and a PNG of the same name beside it; its noise, if told, as another.

    Parameters
    ----------
    raster_map : RasterMap
        float32 maps are written with 16 bits.
    path : Path or str
        The YAML file to write.
    force : bool
        True: replace existing files.

    Raises
    ------
    OutputError
        The files exist, or cannot be written; nothing is left half-written.

    """
    path = Path(path)
    picture, noise = path.with_suffix('.png'), path.with_name(f'{path.stem}_noise.png')
    noisy = raster_map.noise is not None
    for file in (path, picture, *([noise] if noisy else [])):
        if file.exists() and not force:
            raise OutputError(f'{file} exists already, not overwritten; pass another name')
    origin = [float(value) for value in raster_map.origin]
    text = yaml.safe_dump(
        {'image': picture.name, 'resolution': float(raster_map.resolution), 'origin': origin,
         'negate': 0, 'occupied_thresh': 0.65, 'free_thresh': 0.196,
         **({'noise': noise.name} if noisy else {})},
        sort_keys=False, default_flow_style=None,
    )
    write_whole(picture, _png(raster_map.grey, raster_map.valid))
    if raster_map.noise is not None:
        write_whole(noise, _png(raster_map.noise, None))
    write_whole(path, text.encode())


def _settings(path: Path) -> Mapping[str, Any]:
    try:
        settings = yaml.safe_load(path.read_text(encoding='utf-8'))
    except (OSError, UnicodeDecodeError) as error:
        raise MapError(f'map {path}: cannot be read ({error}); expected a nav2 map YAML') from None
    except (yaml.YAMLError, RecursionError) as error:
        raise MapError(f'map {path}: not valid YAML ({" ".join(str(error).split())})') from None
    if not isinstance(settings, dict):
        found = 'nothing' if settings is None else f'a {type(settings).__name__}'
        raise MapError(f'map {path}: holds {found}; expected the keys {", ".join(REQUIRED)}')
    missing = [key for key in REQUIRED if key not in settings]
    if missing:
        raise MapError(
            f'map {path}: no {", ".join(missing)}; found {", ".join(map(str, settings)) or "none"}'
        )
    return settings


def _check_is_file(what: str, image: Path) -> None:
    try:
        found, is_folder = image.is_file(), image.is_dir()
    except OSError as error:
        raise MapError(f'{what} cannot be read ({error.strerror})') from None
    if not found:
        raise MapError(f'{what} {"is a folder" if is_folder else "does not exist"}')


def _number(path: Path, key: str, value: object) -> float:
    # YAML 1.1 takes 5e-2 for a word; map_server takes it, and quoted numbers, for the number.
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        with suppress(OverflowError, ValueError):
            number = float(value)
            if math.isfinite(number):
                return number
    raise MapError(f'map {path}: {key} holds {str(value)[:40]!r}; expected a finite number')


def _pixels(what: str, image: Path) -> Grey:
    """Return what a picture holds, in all its channels."""
    _check_is_file(what, image)
    with decoder_warnings() as warnings:
        try:
            pixels = cv2.imread(str(image), cv2.IMREAD_UNCHANGED)
        except (cv2.error, MemoryError) as error:
            why = ' '.join((getattr(error, 'err', '') or str(error)).split())
            raise MapError(
                f'{what} cannot be read ({why}); expected a whole image that fits into memory, '
                'of at most 2^30 pixels'
            ) from None
    if pixels is None or pixels.dtype not in (np.uint8, np.uint16):
        raise MapError(
            f'{what} cannot be read; expected a whole 8 or 16 bit image, for example PNG or PGM'
        )
    if is_truncated_jpeg(image.read_bytes()):
        raise MapError(f'{what} is cut off; copy it again')
    if damaged := damage(warnings):
        raise MapError(f'{what} is damaged ({damaged}); copy it again')
    return np.asarray(pixels)


def _read_image(what: str, image: Path) -> tuple[Grey, Bools | None]:
    pixels = _pixels(what, image)
    if pixels.ndim == 2:
        return pixels, None
    valid = None
    if pixels.shape[2] in (2, 4):
        valid = pixels[:, :, -1] > 0
    if pixels.shape[2] >= 3:
        grey = cv2.cvtColor(np.ascontiguousarray(pixels[:, :, :3]), cv2.COLOR_BGR2GRAY)
    else:
        grey = np.ascontiguousarray(pixels[:, :, 0])
    return np.asarray(grey), None if valid is None or valid.all() else valid


def _png(grey: Grey, valid: Bools | None) -> bytes:
    if grey.dtype == np.float32:
        grey = np.round(np.clip(grey, 0.0, 1.0) * 65535.0).astype(np.uint16)
    pixels = grey
    if valid is not None:
        alpha = np.where(valid, np.iinfo(grey.dtype).max, 0).astype(grey.dtype)
        pixels = np.dstack([grey, grey, grey, alpha])
    done, encoded = cv2.imencode('.png', np.ascontiguousarray(pixels))
    if not done:
        raise OutputError('the map image could not be encoded as PNG')
    return bytes(encoded)
