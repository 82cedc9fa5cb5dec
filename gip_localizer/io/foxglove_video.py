# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""foxglove_msgs/CompressedVideo, whose stamp and frame are not in a header."""

from __future__ import annotations

from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

VIDEO = 'foxglove_msgs/msg/CompressedVideo'
DEFINITION = 'builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n'


@dataclass(frozen=True)
class VideoPacket:
    """The same, with the attributes of a sensor_msgs/CompressedImage."""

    header: Any
    format: str
    data: Any


def packet_of(message: Any) -> VideoPacket:
    """Return a CompressedVideo as a `VideoPacket`."""
    header = SimpleNamespace(stamp=message.timestamp, frame_id=str(message.frame_id))
    return VideoPacket(header, str(message.format), message.data)
