# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Stamps of images: a file with one line per image, the names of the images, or a rate.

A line holds seconds, milliseconds, microseconds or nanoseconds (recognized by their size), or
date and time in UTC; then, optionally, the name of the image.

"""

from __future__ import annotations

from collections.abc import Sequence
from datetime import datetime, timezone
from decimal import Decimal, InvalidOperation
from itertools import pairwise
from pathlib import Path
import re

from gip_localizer.errors import GipError, quoted
from gip_localizer.io.tum_files import LATEST, UNITS

Stamp = int
Line = tuple[Decimal, str]
NAMES = ('timestamps.txt', 'times.txt', 'data.csv', 'rgb.txt', 'timestamps.csv')
PER_SECOND = {'nanoseconds': 10**9, 'microseconds': 10**6, 'milliseconds': 10**3, 'seconds': 1}
"""Unit → units per second."""
DATE = re.compile(r'(\d{4}-\d\d-\d\d)[ T](\d\d:\d\d:\d\d)(\.\d+)?')
EARLIEST_NAME = 10**8
"""Least number, s, that a file name must be to count as a stamp (of 1973); chosen: running
numbers are smaller."""


class StampError(GipError):
    """Images have no usable stamps."""


def stamps_of(
    images: Sequence[Path], folders: Sequence[Path], *, file: Path | None, rate: float | None
) -> tuple[list[tuple[Stamp, Path]], list[str]]:
    """
    Return stamp (ns) and file of each image in order of time, and notes.

    Parameters
    ----------
    images : sequence of Path
        In the order of their names.
    folders : sequence of Path
        Where a file of stamps is looked for.
    file : Path or None
        The file of the stamps.
    rate : float or None
        Images per second.

    Raises
    ------
    StampError
        There are none, or they do not fit the images.

    """
    if file is not None and rate is not None:
        raise StampError('--timestamps and --rate contradict each other; give one of them')
    if rate is not None:
        if not 0.0 < rate < 1e6:
            raise StampError(f'--rate {rate:g}: expected images per second, '
                             'above 0 and below 1e6')
        return [(round(n * 1e9 / rate), path) for n, path in enumerate(images)], []
    found = file or next((folder / name for folder in folders for name in NAMES
                          if (folder / name).is_file()), None)
    if found is not None:
        pairs, notes = _of_file(found, images)
        return _in_order(pairs, str(found)), notes
    named = [_number(path.stem) for path in images]
    if all(stamp is not None and stamp >= EARLIEST_NAME for stamp in named):
        stamps = [stamp for stamp in named if stamp is not None]
        pairs = list(zip(_nanoseconds(stamps, 'file names'), images, strict=True))
        return _in_order(pairs, 'file names'), ['the images are named by their stamps']
    raise StampError(
        f'the images in {images[0].parent} have no timestamps: expected {", ".join(NAMES[:-1])} '
        'with one line per image, names that are stamps, --timestamps FILE or --rate HZ'
    )


def _of_file(path: Path, images: Sequence[Path]) -> tuple[list[tuple[Stamp, Path]], list[str]]:
    lines = _read(path)
    stamps = _nanoseconds([stamp for stamp, _ in lines], str(path))
    names = [name for _, name in lines]
    if not any(names):
        if len(lines) != len(images):
            raise StampError(
                f'{path} has {len(lines)} stamps for {len(images)} images in '
                f'{images[0].parent}; expected one line per image'
            )
        return list(zip(stamps, images, strict=True)), [f'stamps are taken from {path}']
    known = {image.name: image for image in images}
    missing = [name for name in names if Path(name).name not in known]
    if missing:
        raise StampError(f'{path} names {quoted(missing[0])}, which is not in '
                         f'{images[0].parent} ({len(missing)} of {len(names)} are not)')
    pairs = [(stamp, known[Path(name).name]) for stamp, name in zip(stamps, names, strict=True)]
    left = len(images) - len({path for _, path in pairs})
    return pairs, [f'stamps are taken from {path}'] + (
        [f'{left} images without a stamp are left out'] if left else [])


def _read(path: Path) -> list[Line]:
    try:
        text = path.read_text(encoding='utf-8-sig')
    except (OSError, UnicodeDecodeError) as error:
        raise StampError(f'{path}: cannot be read as text: {error}') from None
    lines = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith('#'):
            continue
        parsed = _parse(line)
        if parsed is not None:
            lines.append(parsed)
        elif lines or number > 1:  # the first line may be a header
            raise StampError(f'{path}:{number}: {quoted(line.strip())} is no stamp; expected a '
                             'number, or date and time, then optionally the name of the image')
    if not lines:
        raise StampError(f'{path}: holds no stamps; expected one line per image')
    return lines


def _parse(line: str) -> Line | None:
    line = line.strip()
    dated = DATE.match(line)
    if dated:
        moment = datetime.fromisoformat(f'{dated[1]}T{dated[2]}').replace(tzinfo=timezone.utc)
        return int(moment.timestamp()) + Decimal(dated[3] or 0), line[dated.end():].strip(', ')
    first, _, rest = line.replace(',', ' ').partition(' ')
    stamp = _number(first)
    return None if stamp is None else (stamp, rest.strip())


def _number(word: str) -> Decimal | None:
    try:
        number = Decimal(word)
    except InvalidOperation:
        return None
    return number if number.is_finite() else None


def _nanoseconds(stamps: Sequence[Decimal], where: str) -> list[Stamp]:
    """Return stamps in nanoseconds; their unit follows from their size."""
    largest = max(map(abs, stamps))
    unit = 'seconds' if largest <= LATEST else next(
        (unit for unit, least in UNITS.items() if largest >= least), None)
    if unit is None:
        raise StampError(f'{where}: {largest} is no time of our days in any unit; expected '
                         'seconds or nanoseconds since 1970 or since the start')
    scale = Decimal(10**9) / PER_SECOND[unit]
    return [int((stamp * scale).to_integral_value()) for stamp in stamps]


def _in_order(pairs: list[tuple[Stamp, Path]], where: str) -> list[tuple[Stamp, Path]]:
    for (before, first), (after, second) in pairwise(pairs):
        if after <= before:
            raise StampError(
                f'{where}: the stamp of {second.name} ({after * 1e-9:.6f} s) is not after that of '
                f'{first.name} ({before * 1e-9:.6f} s); expected stamps that increase'
            )
    return pairs
