# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
One storage file of a bag, read as raw messages; damage becomes a note, not an error.

MCAP is read with `mcap`, by its index where it has one and from front to back where it has none
(recording cut short). sqlite3 is read with `rosbags`.

"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
import errno
from inspect import signature
from pathlib import Path
import struct
from typing import IO, NamedTuple, Protocol

import apsw
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from rosbags.rosbag2 import Reader, ReaderError
import zstandard

from gip_localizer.errors import BagError
from gip_localizer.io.bags.compression import is_compressed, PlainCopy, storage_suffix

END = 2**64
"""Beyond the log times that MCAP can hold."""
SQLITE_END = 2**63 - 1
RECORD_LIMIT = 2**29  # a longer MCAP record, bytes, is taken for damage
# mcap renamed the bounds of a window, start included, stop not.
BOUNDS = ('starting_at', 'ending_before') if 'starting_at' in signature(
    SeekingReader.iter_messages).parameters else ('start_time', 'end_time')
DAMAGE = (McapError, ReaderError, struct.error, ValueError, KeyError, TypeError, RuntimeError,
          EOFError, MemoryError, zstandard.ZstdError, apsw.Error)


class Topic(NamedTuple):
    """A topic of a bag: its name, its type, its number of messages, its encoding."""

    name: str
    msgtype: str
    messages: int
    encoding: str


class BagMessage(NamedTuple):
    """A message as recorded: serialized, with its log time in nanoseconds."""

    topic: str
    msgtype: str
    log_ns: int
    raw: bytes


class Source(Protocol):
    """A part of a bag."""

    path: Path
    topics: list[Topic]
    start_ns: int
    end_ns: int

    @property
    def notes(self) -> list[str]:
        """What could not be read, one line each; grows while reading."""

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield the messages of some topics with start_ns <= log time < stop_ns."""


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
    """A file that its reader takes only decompressed, or under another name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._copy = PlainCopy(path)
        self._source = open_source(self._copy.path)
        self.topics = self._source.topics
        self.start_ns, self.end_ns = self._source.start_ns, self._source.end_ns

    @property
    def notes(self) -> list[str]:
        """What could not be read, under the name of the file itself."""
        copy = str(self._copy.path)
        return [note.replace(copy, str(self.path)) for note in self._source.notes]

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield messages as the source of the copy does."""
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
                      getattr(c.ext, 'serialization_format', 'cdr'))
                for c in reader.connections
            ]

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield messages in order of log time; on damage, note it and end."""
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


class McapSource:
    """An MCAP file, whole or cut short."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.notes: list[str] = []
        self._indexed = False
        try:
            with path.open('rb') as stream:
                summary = SeekingReader(stream, record_size_limit=RECORD_LIMIT).get_summary()
        except DAMAGE:
            summary = None
        except OSError as error:
            if error.errno != errno.EINVAL:  # a seek before the start: a very short file
                raise BagError(f'{path}: cannot be read: {error.strerror}') from None
            summary = None
        if summary is not None and summary.chunk_indexes and summary.statistics is not None:
            self._indexed = True
            self._take(summary)
        else:
            self._scan()

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield messages, by log time or, without an index, as they were recorded."""
        try:
            with self.path.open('rb') as stream:
                if not self._indexed:
                    yield from self._stream(stream, topics, start_ns, stop_ns)
                    return
                reader = SeekingReader(
                    stream, validate_crcs=True, record_size_limit=RECORD_LIMIT
                )
                window = dict(zip(BOUNDS, (start_ns, stop_ns), strict=True))
                for schema, channel, message in reader.iter_messages(list(topics), **window):
                    kind = schema.name if schema is not None else ''
                    yield BagMessage(channel.topic, kind, message.log_time, message.data)
        except DAMAGE as error:
            if self._indexed:
                self.notes.append(f'{self.path}: damaged, the rest is not read: {error}')

    def _take(self, summary: Summary) -> None:
        assert summary.statistics is not None
        self.start_ns = summary.statistics.message_start_time
        self.end_ns = summary.statistics.message_end_time
        counts = summary.statistics.channel_message_counts
        self.topics = [
            Topic(channel.topic, _type_name(summary.schemas.get(channel.schema_id)),
                  counts.get(key, 0), channel.message_encoding)
            for key, channel in sorted(summary.channels.items())
        ]

    def _scan(self) -> None:
        """Learn from the whole file what its missing index would have told."""
        counts: Counter[int] = Counter()
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        first: int | None = None
        last = 0
        try:
            with self.path.open('rb') as stream:
                for record in self._records(stream):
                    if isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel):
                        channels[record.id] = record
                    elif isinstance(record, Message):
                        counts[record.channel_id] += 1
                        first = min(record.log_time, record.log_time if first is None else first)
                        last = max(last, record.log_time)
        except DAMAGE as error:
            self._note_end(error, sum(counts.values()), ((last - (first or 0)) * 1e-9))
        self.start_ns, self.end_ns = first or 0, last
        self.topics = [
            Topic(channel.topic, _type_name(schemas.get(channel.schema_id)), counts[key],
                  channel.message_encoding)
            for key, channel in sorted(channels.items())
        ]

    def _note_end(self, error: BaseException, count: int, seconds: float) -> None:
        reason = str(error) or type(error).__name__
        if count == 0:
            raise BagError(
                f'{self.path}: no message of this MCAP file can be read ({reason}); '
                'record it again or take another copy'
            ) from None
        self.notes.append(
            f'{self.path}: the file is cut short or damaged; {count} messages of its first '
            f'{seconds:.2f} s are read, what follows is not ({reason})'
        )

    def _records(self, stream: IO[bytes]) -> Iterator[object]:
        reader = StreamReader(stream, validate_crcs=True, record_size_limit=RECORD_LIMIT)
        return iter(reader.records)

    def _stream(self, stream: IO[bytes], topics: Collection[str], start_ns: int,
                stop_ns: int) -> Iterator[BagMessage]:
        schemas: dict[int, Schema] = {}
        channels: dict[int, Channel] = {}
        for record in self._records(stream):
            if isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel):
                channels[record.id] = record
            elif isinstance(record, Message) and start_ns <= record.log_time < stop_ns:
                channel = channels[record.channel_id]
                if channel.topic in topics:
                    kind = _type_name(schemas.get(channel.schema_id))
                    yield BagMessage(channel.topic, kind, record.log_time, record.data)


def _type_name(schema: Schema | None) -> str:
    return schema.name if schema is not None else ''
