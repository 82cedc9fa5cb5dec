# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps on disk: a nav2 map_server YAML next to an image (8 or 16 bit, alpha 0 is no data)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from gip_localizer.core.arrays import Bools, Grey, WHITE
from gip_localizer.core.birdseye.rectifier import MASK_USED
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import MapError, OutputError, quoted
from gip_localizer.io.bit_depth import at_full_scale, bits_used
from gip_localizer.io.map_cache import Cells, stored_cells
from gip_localizer.io.map_yaml import map_settings
from gip_localizer.io.output_folder import write_whole
from gip_localizer.io.pictures import check_is_file, read_picture
from gip_localizer.parameters.yaml_files import user_path

READING = '2'
"""Version of the decoding; a new one must not use cells stored by an old one."""


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
        At the image's full depth; inverted when `negate` is 1. A 16 bit image that uses only its
        lower 8, 10, 12 or 14 bits is scaled by what it uses. Large maps are read-only, and
        mapped from disk (`map_store`). Where the YAML names another image as `noise`, it holds
        the standard deviation of each cell, on the scale of its own depth.

    Raises
    ------
    MapError
        Missing or unreadable file, missing key, wrong type, a resolution that no road map has, or
        nothing but transparency.

    """
    path = user_path(path)
    settings = map_settings(path)
    grey, valid = _cells(path, settings.files, 'image', negate=settings.negate)
    if valid is not None and not valid.any():
        raise MapError(
            f'map {path}: its image is transparent all over; expected opaque pixels on the road'
        )
    noise = None
    if settings.files.get('noise') is not None:
        noise, _ = _cells(path, settings.files, 'noise', negate=False)
        if noise.shape != grey.shape:
            raise MapError(
                f'map {path}: its noise has {noise.shape[1]}x{noise.shape[0]} cells, its image '
                f'{grey.shape[1]}x{grey.shape[0]}; expected the same'
            )
    return RasterMap(
        grey, settings.resolution, settings.origin, valid, noise, settings.accuracy
    )


def _cells(path: Path, settings: Mapping[str, Any], key: str, *, negate: bool) -> Cells:
    """Return the cells of the image file that a key names."""
    if not isinstance(settings[key], str):
        raise MapError(f'map {path}: {key} is {quoted(settings[key])}; expected a file name')
    image = path.parent / user_path(settings[key])
    what = f'map {path}: its {key} {image}'
    check_is_file(what, image)

    def decode() -> Cells:
        grey, valid = read_picture(what, image)
        if key == 'image' and grey.dtype == np.uint16:
            grey = at_full_scale(grey, bits_used(grey))
        return (WHITE[grey.dtype] - grey).astype(grey.dtype) if negate else grey, valid

    return stored_cells(image, f'{"negated" if negate else "as-is"}-{key}-{READING}', decode)


def load_mask(path: Path | str) -> Grey:
    """
    Read the mask of the parts of the image that always show the own vehicle.

    Parameters
    ----------
    path : Path or str
        An 8 bit image of the camera's size: white is used, black is not.

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
    grey, _ = read_picture(what, user_path(path))
    if grey.dtype != np.uint8:
        raise MapError(f'{what} has 16 bits a pixel; expected 8')
    if grey.max() < MASK_USED:
        raise MapError(
            f'{what} is black all over (largest value {grey.max()}), so that no pixel would be '
            'used; expected 255, and black only where the camera sees its own vehicle'
        )
    return np.ascontiguousarray(grey)


def save_map(raster_map: RasterMap, path: Path | str, *, force: bool = False) -> None:
    """
    Write a map as YAML and a PNG of the same name; its noise, if known, as another PNG.

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
         **({'noise': noise.name} if noisy else {}),
         **{key: float(f'{value:.3g}')
            for key, value in raster_map.accuracy._asdict().items() if value > 0.0}},
        sort_keys=False, default_flow_style=None,
    )
    write_whole(picture, _png(raster_map.grey, raster_map.valid))
    if raster_map.noise is not None:
        write_whole(noise, _png(raster_map.noise, None))
    write_whole(path, text.encode())


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
