# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Disk cache of the decoded cells of large maps, so that only the used part occupies memory.

An image can only be decoded as a whole. Its cells are then stored in the user's cache folder under
the hash of the image file, and mapped into memory, also at the next start. The size of the folder
is limited; the oldest entries are deleted first. If it cannot be written, the map stays in memory.

"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import hashlib
import mmap
import os
from pathlib import Path
import tempfile
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Bools, Grey

LARGE = 4_000_000
"""Number of cells above which a map is stored on disk; chosen: 4 to 16 MB in memory."""
MOST_BYTES = 8 << 30
"""Largest size (bytes) of all maps in the folder, 8 GiB; chosen."""
Cells = tuple[Grey, Bools | None]


def stored_cells(image: Path, variant: str, decode: Callable[[], Cells]) -> Cells:
    """
    Return the cells of an image, mapped from disk if there are many.

    Parameters
    ----------
    image : Path
        The picture.
    variant : str
        Name of the processing, since several results can come from one image.
    decode : callable
        Computes the cells if they are not stored yet.

    Returns
    -------
    grey : (rows, cols) array
        Read-only where mapped.
    valid : (rows, cols) bool or None
        As `decode` returned it.

    """
    try:
        entry = store_folder() / f'{_digest(image)}-{variant}'
    except (OSError, RuntimeError):  # unreadable, or a user without a home
        return decode()
    with suppress(OSError, ValueError):
        return _opened(entry)
    cells = decode()
    if cells[0].size <= LARGE:
        return cells
    with suppress(OSError, ValueError):
        _remove(entry)
        _write(entry, cells)
        return _opened(entry)
    return cells


def store_folder() -> Path:
    """Return the folder of the cells, which may not exist yet."""
    cache = os.environ.get('XDG_CACHE_HOME')
    base = Path(cache) if cache else Path.home() / '.cache'
    return base / 'gip_localizer' / 'maps'


def _digest(image: Path) -> str:
    digest = hashlib.sha256()
    with image.open('rb') as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()[:32]


def _opened(entry: Path) -> Cells:
    """Map an entry (raises OSError or ValueError if it is missing or incomplete)."""
    grey = _mapped(entry / 'grey.npy')
    os.utime(entry)  # the least recently used is deleted first
    valid = entry / 'valid.npy'
    return grey, _mapped(valid) if valid.exists() else None


def _mapped(path: Path) -> np.ndarray[Any, Any]:
    with path.open('rb') as stream:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0
        if version != (1, 0):
            raise ValueError(f'{path}: unknown version {version}')
        shape, _, dtype = read(stream)
        start = stream.tell()
        pages = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    if hasattr(mmap, 'MADV_RANDOM'):
        pages.madvise(mmap.MADV_RANDOM)  # a window is a few cells of many rows
    count = int(np.prod(shape))
    return np.frombuffer(pages, dtype, count, start).reshape(shape)


def _write(entry: Path, cells: Cells) -> None:
    """Write an entry under a temporary name, rename it, then delete old entries."""
    entry.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=entry.parent, prefix='.writing-') as folder:
        part = Path(folder) / 'entry'
        part.mkdir()
        for name, array in zip(('grey', 'valid'), cells, strict=True):
            if array is not None:
                np.save(part / f'{name}.npy', np.ascontiguousarray(array), allow_pickle=False)
        with suppress(OSError):  # another process was first
            part.rename(entry)
    _make_room(entry)


def _make_room(newest: Path) -> None:
    entries = [e for e in newest.parent.iterdir() if e.is_dir() and not e.name.startswith('.')]
    entries.sort(key=lambda e: e.stat().st_mtime, reverse=True)
    total = 0
    for entry in entries:
        total += sum(file.stat().st_size for file in entry.iterdir())
        if total > MOST_BYTES and entry != newest:
            _remove(entry)


def _remove(entry: Path) -> None:
    if entry.is_dir():
        for file in entry.iterdir():
            file.unlink(missing_ok=True)
        entry.rmdir()
