# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Joins a running graph, and listens to the topics of a localizer for some seconds."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo

from gip_localizer.io.foxglove_video import packet_of
from gip_localizer.io.image_stream import ImageStream
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.ros.doctor.graph import image_type, SIM_TIME, StackGraph, TICK
from gip_localizer.ros.doctor.observed import Asked, Heard, Observed
from gip_localizer.ros.endpoints import listen_to_latched

try:
    from tf2_msgs.msg import TFMessage
except ImportError:
    TFMessage = None

KEPT = 1000
"""Number of messages that may wait to be processed; chosen."""


def observed(asked: Asked, progress: Callable[[float], object]) -> Observed:
    """
    Listen to a running stack.

    Parameters
    ----------
    asked : Asked
        Names that the user gave.
    progress : callable
        Called with the seconds so far.

    Raises
    ------
    GipError
        Several localizers run and none is named, or the parameter file cannot be used.

    """
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    node = Node('gip_doctor', enable_rosout=False, start_parameter_services=False)
    try:
        graph = StackGraph(node)
        seen = _found(graph, asked)
        _Ears(node, seen)
        began = time.monotonic()
        while (elapsed := time.monotonic() - began) < asked.seconds:
            graph.spin(TICK)
            progress(elapsed)
        graph.look_at(seen)
        return seen
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


def _found(graph: StackGraph, asked: Asked) -> Observed:
    """Find the localizer and its topics."""
    name = graph.localizer(asked.node)
    values = graph.parameters(name)
    sim_time = bool(values.pop(SIM_TIME, False))
    parameters = Parameters.from_dict(values)
    if asked.params is not None:
        parameters = load_parameter_file(asked.params)
    return Observed(
        asked.seconds, name, graph.state(name), parameters, sim_time,
        graph.topics(asked, name, parameters), tf_known=TFMessage is not None,
    )  # fmt: skip


class _Ears:
    """The subscriptions; their messages are collected in an `Observed`."""

    def __init__(self, node: Node, seen: Observed) -> None:
        self._node, self._seen = node, seen
        kinds = {'image': image_type(seen.parameters), 'camera_info': CameraInfo,
                 'odom': Odometry, 'pose': PoseStamped}
        for role, kind in kinds.items():
            self._hear(kind, seen.topics[role].topic, self._keeper(seen.topics[role]))
        self._hear(Clock, '/clock', self._on_clock)
        self._hear(DiagnosticArray, '/diagnostics', self._on_diagnostics)
        if TFMessage is not None:
            for topic in ('/tf', '/tf_static'):
                self._hear(TFMessage, topic, self._on_transforms)

    def _hear(self, kind: Any, topic: str, use: Callable[[Any], None]) -> None:
        """Subscribe with a QoS that is compatible with every publisher."""
        listen_to_latched(self._node, kind, topic, use, QoSProfile(
            depth=KEPT, reliability=ReliabilityPolicy.BEST_EFFORT
        ))  # fmt: skip

    def _keeper(self, heard: Heard) -> Callable[[Any], None]:
        stream = ImageStream()

        def keep(message: Any) -> None:
            if hasattr(message, 'timestamp'):  # foxglove_msgs/CompressedVideo
                message = packet_of(message)
            heard.arrivals_ns.append(self._now_ns())
            heard.stamps_ns.append(stamp_ns(message.header))
            heard.frames.add(str(message.header.frame_id))
            heard.last = stream.taken(message)

        return keep

    def _now_ns(self) -> int:
        """Return the time of the stack."""
        if self._seen.sim_time:
            return self._seen.clocks_ns[-1] if self._seen.clocks_ns else 0
        return time.time_ns()

    def _on_clock(self, message: Clock) -> None:
        self._seen.clocks_ns.append(message.clock.sec * 1_000_000_000 + message.clock.nanosec)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            node, _, group = status.name.partition(': ')
            if f'/{node}' == self._seen.node:
                self._seen.statuses[group] = (ord(status.level), status.message)

    def _on_transforms(self, message: Any) -> None:
        self._seen.transforms |= {(one.header.frame_id.lstrip('/'),
                                   one.child_frame_id.lstrip('/')) for one in message.transforms}
