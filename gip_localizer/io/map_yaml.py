# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The YAML file of a map: nav2 map_server's keys, and those that only this package reads."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
import math
from pathlib import Path
from typing import Any

from gip_localizer.core.map.accuracy import MapAccuracy
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError, quoted, shortened
from gip_localizer.parameters.yaml_files import read_yaml, YamlFileError

REQUIRED = ('image', 'resolution', 'origin')
MODES = ('trinary', 'scale', 'raw')
"""Values of `mode` in nav2 map_server; accepted, but not used: no occupancy is computed here."""
FINEST, COARSEST = 1e-4, 100.0
"""Accepted range of the resolution (m per cell); chosen: outside it, the unit must be wrong."""
WORST = MapAccuracy(sigma_xy=10.0, sigma_yaw=0.1)
"""Largest accepted standard deviations, m and rad; chosen: those of the parameters `map.*`."""


@dataclass(frozen=True)
class MapSettings:
    """
    Content of a map YAML.

    Attributes
    ----------
    resolution : float
        Side of a cell, metres.
    origin : Pose2
        Of the lower-left corner of the lower-left cell.
    negate : bool
        Whether black and white are exchanged.
    accuracy : MapAccuracy
        From the optional keys sigma_xy (m) and sigma_yaw (rad), which other readers ignore.
    files : mapping
        image and, perhaps, noise → file name, relative to the YAML file; not checked.

    """

    resolution: float
    origin: Pose2
    negate: bool
    accuracy: MapAccuracy
    files: Mapping[str, Any]


def map_settings(path: Path) -> MapSettings:
    """Read a map YAML without its pictures (raises MapError)."""
    settings = _settings(path)
    resolution = _number(path, 'resolution', settings['resolution'])
    if not FINEST <= resolution <= COARSEST:
        raise MapError(
            f'map {path}: resolution is {resolution:g}; expected metres per cell, '
            f'{FINEST:g} to {COARSEST:g}'
        )
    origin = settings['origin']
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f'map {path}: origin is {quoted(origin)}; expected [x, y, yaw]')
    x, y, yaw = (_number(path, 'origin', value) for value in origin)
    negate = settings.get('negate', 0)
    if negate not in (0, 1, False, True):
        raise MapError(f'map {path}: negate is {quoted(negate)}; expected 0 or 1')
    if settings.get('mode', MODES[0]) not in MODES:
        raise MapError(f'map {path}: mode is {quoted(settings["mode"])}; expected '
                       + ', '.join(MODES))
    return MapSettings(
        resolution=resolution, origin=Pose2(x, y, yaw), negate=bool(negate),
        accuracy=_accuracy(path, settings), files=settings,
    )


def _accuracy(path: Path, settings: Mapping[str, Any]) -> MapAccuracy:
    """Return the accuracy that a map YAML states (raises MapError)."""
    stated = MapAccuracy(*(_number(path, key, settings.get(key, 0.0))
                           for key in MapAccuracy._fields))
    for key, value, most in zip(MapAccuracy._fields, stated, WORST, strict=True):
        if not 0.0 <= value <= most:
            raise MapError(f'map {path}: {key} is {value:g}; expected 0 (exact) to {most:g}')
    return stated


def _settings(path: Path) -> Mapping[str, Any]:
    try:
        settings = read_yaml(path)
    except FileNotFoundError:
        raise MapError(f'map {path}: cannot be read, there is no such file; expected a nav2 map '
                       'YAML') from None
    except YamlFileError as error:
        raise MapError(f'map {path}: {error}; expected a nav2 map YAML') from None
    if not isinstance(settings, dict):
        found = 'nothing' if settings is None else f'a {type(settings).__name__}'
        raise MapError(f'map {path}: holds {found}; expected the keys {", ".join(REQUIRED)}')
    missing = [key for key in REQUIRED if key not in settings]
    if missing:
        raise MapError(
            f'map {path}: no {", ".join(missing)}; found '
            + (shortened(', '.join(map(str, settings))) or 'none')
        )
    return settings


def _number(path: Path, key: str, value: object) -> float:
    # YAML 1.1 takes 5e-2 for a word; map_server takes it, and quoted numbers, for the number.
    if isinstance(value, (int, float, str)) and not isinstance(value, bool):
        with suppress(OverflowError, ValueError):
            number = float(value)
            if math.isfinite(number):
                return number
    raise MapError(f'map {path}: {key} holds {quoted(str(value))}; expected a finite number')
