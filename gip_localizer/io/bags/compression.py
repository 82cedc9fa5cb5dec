# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Zstandard compression of rosbag2: of whole files, or of each message."""

from __future__ import annotations

from pathlib import Path
import tempfile

import zstandard

from gip_localizer.errors import BagError

SUFFIXES = ('.zstd', '.zst')
MAGIC = b'\x28\xb5\x2f\xfd'
"""First bytes of compressed data; serialized messages begin with 0."""
MESSAGE_LIMIT = 1 << 29
"""Largest size (bytes) of a message, 512 MiB; chosen: a larger one is damaged."""


def storage_suffix(path: Path) -> str:
    """Return the suffix of a storage file in lower case, without that of its compression."""
    compressed = path.suffix.lower() in SUFFIXES
    return Path(path.stem if compressed else path.name).suffix.lower()


def is_compressed(path: Path) -> bool:
    """Whether a file is compressed as a whole, by its name."""
    return path.suffix.lower() in SUFFIXES


class PlainCopy:
    """
    A storage file in the form that its readers need: decompressed, suffix in lower case.

    It is in a temporary folder that is deleted with this object; a file that is not compressed is
    only linked there.

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
                'set TMPDIR to a folder with enough space'
            ) from None


def uncompressed(raw: bytes) -> bytes:
    """Return the uncompressed bytes of a message (raises ZstdError)."""
    if raw[:4] != MAGIC:
        return raw
    return zstandard.ZstdDecompressor().decompress(raw, max_output_size=MESSAGE_LIMIT)
