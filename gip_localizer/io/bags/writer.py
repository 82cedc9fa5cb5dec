# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Writing of rosbag2 MCAP bags without ROS; the same messages give the same bytes.

Message classes and serialization are those of `rosbags`, with ROS 2 Jazzy's definitions.

"""

from __future__ import annotations

from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from types import TracebackType
from typing import Any

from rosbags.interfaces import (
    Connection,
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter, write_channel, write_string

from gip_localizer.core.pose import Pose2
from gip_localizer.io.cdr import jazzy
from gip_localizer.io.messages import quaternion_of_yaw


def make(msgtype: str, **fields: Any) -> Any:
    """Build a message of a type by name, e.g. `make('std_msgs/msg/String', data='a')`."""
    return jazzy().types[msgtype](**fields)


def make_header(stamp_ns: int, frame_id: str) -> Any:
    """Build a std_msgs/Header from integer nanoseconds."""
    sec, nanosec = divmod(stamp_ns, 1_000_000_000)
    stamp = make('builtin_interfaces/msg/Time', sec=sec, nanosec=nanosec)
    return make('std_msgs/msg/Header', stamp=stamp, frame_id=frame_id)


def make_pose(pose: Pose2) -> Any:
    """Build a geometry_msgs/Pose in the plane."""
    x, y, z, w = quaternion_of_yaw(pose.yaw)
    return make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', x=pose.x, y=pose.y, z=0.0),
        orientation=make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
    )


class _HashingStorage(McapWriter):
    """MCAP whose channels carry `topic_type_hash`, as rosbag2 of Jazzy writes them."""

    def add_connection(self, connection: Connection, offered_qos_profiles: str) -> None:
        """Declare a channel, and write it again with the hash of its type."""
        before = self.chunk.bio.tell()
        super().add_connection(connection, offered_qos_profiles)
        metadata = BytesIO()
        write_string(metadata, 'topic_type_hash')
        write_string(metadata, connection.digest)
        plain = self.channels[-1]
        self.channels[-1] = plain._replace(metadata=plain.metadata + metadata.getvalue())
        self.chunk.bio.seek(before)
        self.chunk.bio.truncate()
        write_channel(self.chunk.bio, self.channels[-1], self.schemas)


class BagWriter:
    """
    A rosbag2 folder with one MCAP file; use as a context manager.

    On leaving with an exception the file has no index; the caller removes the folder.

    """

    def __init__(self, path: Path, topics: Mapping[str, str], *, compress: bool = False,
                 latched: frozenset[str] = frozenset()) -> None:
        """
        Declare what will be written.

        Parameters
        ----------
        path : Path
            Folder to make; must not exist.
        topics : dict
            Topic to type name, in the order of declaration.
        compress : bool
            True: chunks are compressed with zstd.
        latched : frozenset of str
            Topics offered transient local.

        """
        self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
        self._writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: _HashingStorage}
        if compress:
            self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._topics = dict(topics)
        self._latched = latched
        self._connections: dict[str, Connection] = {}

    def __enter__(self) -> BagWriter:
        """Make the folder and declare the topics."""
        self._writer.open()
        for topic, msgtype in self._topics.items():
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=jazzy(),
                offered_qos_profiles=[qos_of_topic(latched=topic in self._latched)],
            )
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        """Write the index and close."""
        self._writer.__exit__(kind, error, trace)

    def write(self, topic: str, log_ns: int, message: Any) -> None:
        """Append a message of the topic's declared type at a log time in nanoseconds."""
        raw = jazzy().serialize_cdr(message, self._topics[topic])
        self._writer.write(self._connections[topic], log_ns, raw)


def qos_of_topic(*, latched: bool) -> Qos:
    """Return the quality of service of a topic: reliable, and kept for late readers if latched."""
    unset = QosTime(0, 0)
    return Qos(
        history=QosHistory.KEEP_LAST,
        depth=10,
        reliability=QosReliability.RELIABLE,
        durability=QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
        deadline=unset, lifespan=unset, liveliness=QosLiveliness.SYSTEM_DEFAULT,
        liveliness_lease_duration=unset, avoid_ros_namespace_conventions=False,
    )
