# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that this project's own writer does not write, made with mcap and rosbags directly."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer

from gip_localizer.core.pose import Pose2
from gip_localizer.io.bags.writer import make, make_header, make_pose
from gip_localizer.io.cdr import jazzy
from gip_localizer.io.messages import full_covariance

IMAGE, INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'
ODOM, POSE = 'nav_msgs/msg/Odometry', 'geometry_msgs/msg/PoseStamped'
EPOCH = 1_700_000_000_000_000_000
Stamped = tuple[str, str, int, Any]


def image(stamp_ns: int, rows: int = 12, cols: int = 16, seed: int = 0) -> Any:
    pixels = np.random.default_rng(seed).integers(0, 256, rows * cols, np.uint8)
    return make(IMAGE, header=make_header(stamp_ns, 'camera'), height=rows, width=cols,
                encoding='mono8', is_bigendian=0, step=cols, data=pixels)


def odometry(stamp_ns: int, pose: Pose2) -> Any:
    vector = make('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=0.0)
    covariance = full_covariance(np.eye(3) * 1e-4)
    return make(
        ODOM, header=make_header(stamp_ns, 'odom'), child_frame_id='base_link',
        pose=make('geometry_msgs/msg/PoseWithCovariance', pose=make_pose(pose),
                  covariance=covariance),
        twist=make('geometry_msgs/msg/TwistWithCovariance',
                   twist=make('geometry_msgs/msg/Twist', linear=vector, angular=vector),
                   covariance=covariance),
    )


def small_drive(count: int = 20) -> list[Stamped]:
    """Images at 10 Hz and odometry at 20 Hz, interleaved by log time."""
    stream: list[Stamped] = []
    for i in range(count):
        stamp = EPOCH + i * 100_000_000
        stream.append(('/camera/image', IMAGE, stamp, image(stamp, seed=i)))
        for half in (10_000_000, 60_000_000):
            stream.append(('/odom', ODOM, stamp + half, odometry(stamp + half, Pose2(i, 0, 0))))
    return stream


def serialized(stream: Iterable[Stamped]) -> list[tuple[str, str, int, bytes]]:
    return [
        (topic, kind, log, bytes(jazzy().serialize_cdr(message, kind)))
        for topic, kind, log, message in stream
    ]


def write_mcap(path: Path, stream: Iterable[tuple[str, str, int, bytes]], *,
               compression: CompressionType = CompressionType.NONE, chunked: bool = True,
               index: bool = True, chunk_size: int = 1024,
               encodings: dict[str, str] | None = None) -> Path:
    """Write with the `mcap` package, as recorders other than this project's do."""
    writer = McapWriter(str(path), compression=compression, chunk_size=chunk_size,
                        use_chunking=chunked, use_summary_offsets=index)
    writer.start(profile='ros2', library='test')
    channels: dict[str, int] = {}
    for topic, kind, log, raw in stream:
        if topic not in channels:
            encoding = (encodings or {}).get(topic, 'cdr')
            schema = writer.register_schema(kind, 'ros2msg', b'# as the recorder knew it')
            channels[topic] = writer.register_channel(topic, encoding, schema)
        writer.add_message(channels[topic], log, raw, log)
    writer.finish()
    return path


def write_rosbag2(path: Path, stream: Iterable[tuple[str, str, int, bytes]],
                  plugin: StoragePlugin = StoragePlugin.SQLITE3, version: Any = 9) -> Path:
    with Writer(path, version=version, storage_plugin=plugin) as writer:
        connections: dict[str, Any] = {}
        for topic, kind, log, raw in stream:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=jazzy())
            writer.write(connections[topic], log, raw)
    return path
