# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Opening of a storage file of a bag; damage becomes a note, not an error.

MCAP is read with `mcap`, sqlite3 with `rosbags`.

"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path

from rosbags.rosbag2 import Reader

from gip_localizer.errors import BagError
from gip_localizer.io.bags.compression import is_compressed, PlainCopy, storage_suffix
from gip_localizer.io.bags.mcap_source import McapSource
from gip_localizer.io.bags.offered_qos import offered_by
from gip_localizer.io.bags.source import BagMessage, DAMAGE, Source, Topic

SQLITE_END = 2**63 - 1
"""Largest log time (ns) of a sqlite3 file, whose integers are signed with 64 bits."""


def open_source(path: Path) -> Source:
    """
    Open a storage file.

    Raises
    ------
    BagError
        Nothing in it can be read.

    """
    if is_compressed(path) or path.suffix != path.suffix.lower():
        return CopiedSource(path)
    if storage_suffix(path) == '.mcap':
        return McapSource(path)
    try:
        return RosbagsSource(path)
    except (*DAMAGE, OSError) as error:
        raise BagError(f'{path}: cannot be read as a bag: {error}') from None


class CopiedSource:
    """A file that is read from a decompressed or renamed copy."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._copy = PlainCopy(path)
        self._source = open_source(self._copy.path)
        self.topics = self._source.topics
        self.start_ns, self.end_ns = self._source.start_ns, self._source.end_ns

    @property
    def notes(self) -> list[str]:
        """Warnings about unreadable parts, with the name of the original file."""
        copy = str(self._copy.path)
        return [note.replace(copy, str(self.path)) for note in self._source.notes]

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield the messages of the copy."""
        return self._source.messages(topics, start_ns, stop_ns)


class RosbagsSource:
    """A sqlite3 file, which `rosbags` reads."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        with Reader(path) as reader:
            self.start_ns, self.end_ns = reader.start_time, reader.end_time
            self.topics = [
                Topic(c.topic, c.msgtype, c.msgcount,
                      getattr(c.ext, 'serialization_format', 'cdr'),
                      offered_by(getattr(c.ext, 'offered_qos_profiles', ())))
                for c in reader.connections
            ]

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield messages in order of log time; stop at damage, with a note."""
        try:
            with Reader(self.path) as reader:
                wanted = [c for c in reader.connections if c.topic in topics]
                if not wanted:
                    return
                for connection, log_ns, raw in reader.messages(
                        wanted, start_ns, min(stop_ns, SQLITE_END)):
                    yield BagMessage(connection.topic, connection.msgtype, log_ns, raw)
        except DAMAGE as error:
            self.notes.append(f'{self.path}: damaged, the rest is not read: {error}')
