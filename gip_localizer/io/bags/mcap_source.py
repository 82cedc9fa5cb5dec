# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
An MCAP file as a source of messages.

It is read by its index or, if the recording was interrupted and it has none, from start to end.

"""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
import errno
from inspect import signature
from pathlib import Path
from typing import IO

from mcap.reader import SeekingReader
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from gip_localizer.errors import BagError
from gip_localizer.io.bags.offered_qos import offered_qos
from gip_localizer.io.bags.source import BagMessage, DAMAGE, Topic

RECORD_LIMIT = 2**29
"""Largest size (bytes) of an MCAP record, 512 MiB; chosen: a longer one is damaged."""
BOUNDS = ('starting_at', 'ending_before') if 'starting_at' in signature(
    SeekingReader.iter_messages).parameters else ('start_time', 'end_time')
"""Names of the arguments for first and end log time, which depend on the version of mcap."""


class McapSource:
    """An MCAP file, complete or truncated."""

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
        """Yield messages by log time or, without an index, in the order of recording."""
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
            _topic(channel, summary.schemas.get(channel.schema_id), counts.get(key, 0))
            for key, channel in sorted(summary.channels.items())
        ]

    def _scan(self) -> None:
        """Read the whole file to get topics, counts and times, which an index would contain."""
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
            _topic(channel, schemas.get(channel.schema_id), counts[key])
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
            f'{self.path}: the file is truncated or damaged; {count} messages of its first '
            f'{seconds:.2f} s are read, the rest is not ({reason})'
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


def _topic(channel: Channel, schema: Schema | None, messages: int) -> Topic:
    return Topic(channel.topic, _type_name(schema), messages, channel.message_encoding,
                 offered_qos(channel.metadata.get('offered_qos_profiles', '')))


def _type_name(schema: Schema | None) -> str:
    return schema.name if schema is not None else ''
