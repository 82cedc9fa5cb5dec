# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Interface of a storage file of a bag: its topics and its serialized messages."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
import struct
from typing import NamedTuple, Protocol

import apsw
from mcap.exceptions import McapError
from rosbags.rosbag2 import ReaderError
import zstandard

from gip_localizer.io.bags.offered_qos import OfferedQos

END = 2**64
"""First value (ns) beyond the log times of MCAP, which are unsigned with 64 bits."""
DAMAGE = (McapError, ReaderError, struct.error, ValueError, KeyError, TypeError, RuntimeError,
          EOFError, MemoryError, zstandard.ZstdError, apsw.Error)
"""Exceptions that the readers raise for a damaged file."""


class Topic(NamedTuple):
    """
    A topic of a bag: its name, its type, its number of messages, its encoding.

    `offered` is the quality of service of each of its publishers, where it was recorded.

    """

    name: str
    msgtype: str
    messages: int
    encoding: str
    offered: tuple[OfferedQos, ...] = ()


class BagMessage(NamedTuple):
    """A message as recorded: serialized, with its log time in nanoseconds."""

    topic: str
    msgtype: str
    log_ns: int
    raw: bytes


class Source(Protocol):
    """A storage file of a bag."""

    path: Path
    topics: list[Topic]
    start_ns: int
    end_ns: int

    @property
    def notes(self) -> list[str]:
        """Warnings about unreadable parts, one line each; grows while reading."""

    def messages(self, topics: Collection[str], start_ns: int,
                 stop_ns: int) -> Iterator[BagMessage]:
        """Yield the messages of some topics with start_ns <= log time < stop_ns."""
