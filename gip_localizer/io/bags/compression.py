# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Zstandard, as rosbag2 compresses with it: whole files, or each message for itself."""

from __future__ import annotations

from pathlib import Path
import tempfile

import zstandard

from gip_localizer.errors import BagError

SUFFIXES = ('.zstd', '.zst')
MAGIC = b'\x28\xb5\x2f\xfd'
"""First bytes of compressed data; serialized messages begin with 0."""
MESSAGE_LIMIT = 1 << 29
"""Bytes of a message; a larger one is taken for damage."""


def storage_suffix(path: Path) -> str:
    """Return the suffix of a storage file in lower case, without that of its compression."""
    compressed = path.suffix.lower() in SUFFIXES
    return Path(path.stem if compressed else path.name).suffix.lower()


def is_compressed(path: Path) -> bool:
    """Tell whether a file is compressed as a whole, by its name."""
    return path.suffix.lower() in SUFFIXES


class PlainCopy:
    """
    A storage file as its readers take it: decompressed, and its suffix in lower case.

    It lies in a temporary folder for as long as this object lives; a file that is not compressed
    is only linked from there.

    Attributes
    ----------
    path : Path
        The copy or link.

    Raises
    ------
    BagError
        The file cannot be read or decompressed, or the temporary folder cannot hold it.

    """

    def __init__(self, path: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix='gip_localizer-')
        self.path = Path(self._folder.name) / f'bag{storage_suffix(path)}'
        if not is_compressed(path):
            self.path.symlink_to(path.resolve())
            return
        try:
            with path.open('rb') as source, self.path.open('wb') as target:
                zstandard.ZstdDecompressor().copy_stream(source, target)
        except zstandard.ZstdError as error:
            raise BagError(f'{path}: cannot be decompressed: {error}') from None
        except OSError as error:
            raise BagError(
                f'{path}: cannot be decompressed into {self._folder.name}: {error.strerror}; '
                'TMPDIR names another folder'
            ) from None


def plain(raw: bytes) -> bytes:
    """Return a message as it was before compression (raises ZstdError)."""
    if raw[:4] != MAGIC:
        return raw
    return zstandard.ZstdDecompressor().decompress(raw, max_output_size=MESSAGE_LIMIT)
