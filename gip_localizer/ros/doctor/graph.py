# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Finds a localizer on a running graph, its parameters and the topics that it hears."""

from __future__ import annotations

import time
from typing import Any

from geometry_msgs.msg import PoseStamped
from lifecycle_msgs.srv import GetState
from nav_msgs.msg import Odometry
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from gip_localizer.errors import GipError
from gip_localizer.parameters import Parameters
from gip_localizer.ros.doctor.observed import Asked, Heard, Observed
from gip_localizer.ros.endpoints import qos_conflict
from gip_localizer.ros.localizer.subscriptions import video_type

MARK = '/relocalize_and_wait'
"""Service that only a localizer offers."""
DISCOVERY = 3.0
"""Longest time to wait for a localizer to be discovered, seconds; Fast DDS takes 1 to 3 s."""
SETTLING = 0.5
"""Time for the rest of the graph to be discovered, seconds; chosen."""
ANSWER = 3.0
"""Longest time to wait for an answer of the node, seconds; chosen."""
TICK = 0.05
"""Period at which the graph is looked at, seconds; chosen."""
SIM_TIME = 'use_sim_time'


class StackGraph:
    """
    The graph that a node has joined.

    Parameters
    ----------
    node : Node
        Sees the graph.

    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)

    def spin(self, seconds: float) -> None:
        """Process messages for a time (s)."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self._executor.spin_once(timeout_sec=TICK)

    def localizer(self, named: str | None) -> str:
        """Return the full name of the localizer; empty if none runs."""
        until = time.monotonic() + DISCOVERY
        found: list[str] = []
        while not found and time.monotonic() < until:
            self._executor.spin_once(timeout_sec=TICK)
            found = self._localizers(named)
        self.spin(SETTLING)
        found = self._localizers(named)
        if len(found) > 1:
            raise GipError(f'{len(found)} localizers run: {", ".join(found)}; name one: '
                           f'gip doctor --topics --node {found[0]}')
        return found[0] if found else ''

    def _localizers(self, named: str | None) -> list[str]:
        """Return the nodes that are localizers, or the one that is named."""
        nodes = {f'{space.rstrip("/")}/{name}'
                 for name, space in self._node.get_node_names_and_namespaces()}
        if named is not None:
            return [f'/{named.lstrip("/")}'] if f'/{named.lstrip("/")}' in nodes else []
        services = [name for name, _ in self._node.get_service_names_and_types()]
        serving = {name.removesuffix(MARK) for name in services if name.endswith(MARK)}
        # One that is managed and not configured offers its states only.
        managed = {name.removesuffix('/get_state') for name in services
                   if name.endswith('/localizer/get_state')}
        return sorted((serving | managed) & nodes)

    def parameters(self, name: str) -> dict[str, object]:
        """Return the parameters of the localizer, with use_sim_time; empty: it does not answer."""
        names = [SIM_TIME, *(spec.name for spec in Parameters.specs())]
        answer = self._ask(GetParameters, name, 'get_parameters',
                           GetParameters.Request(names=names))
        values = [] if answer is None else answer.values
        return {key: value for key, one in zip(names, values, strict=False)
                if (value := parameter_value_to_python(one)) is not None}

    def state(self, name: str) -> str:
        """Return the state of a managed localizer; empty where it has none."""
        if GetState is None or not any(
            service == f'{name}/get_state'
            for service, _ in self._node.get_service_names_and_types()
        ):
            return ''
        answer = self._ask(GetState, name, 'get_state', GetState.Request())
        return '' if answer is None else str(answer.current_state.label)

    def _ask(self, kind: Any, name: str, service: str, request: Any) -> Any:
        """Call a service of the localizer; None where it does not answer."""
        if not name:
            return None
        client = self._node.create_client(kind, f'{name}/{service}')
        if not client.wait_for_service(ANSWER):
            return None
        self.spin(SETTLING)
        future = client.call_async(request)
        until = time.monotonic() + ANSWER
        while not future.done() and time.monotonic() < until:
            self._executor.spin_once(timeout_sec=TICK)
        return future.result() if future.done() else None

    def topics(self, asked: Asked, name: str, parameters: Parameters) -> dict[str, Heard]:
        """Return the topics of a localizer, by role."""
        topics = {'pose': Heard(self._published(name) or '/pose')}
        for role, kind in _kinds(parameters).items():
            raw = role != 'image' or kind is Image
            default = f'/{role}' if raw else f'/{role}/{parameters.image_transport}'
            topic = asked.topics.get(role) or self._of_node(name, kind) or default
            topics[role] = Heard(f'/{topic.lstrip("/")}')
        return topics

    def look_at(self, seen: Observed) -> None:
        """Note who publishes the inputs, once everyone was discovered."""
        for role, kind in _kinds(seen.parameters).items():
            heard = seen.topics[role]
            publishers = self._node.get_publishers_info_by_topic(heard.topic)
            qos = self._qos_of(seen.node, heard.topic) or _expected(seen.parameters, role)
            heard.publishers = len(publishers)
            heard.conflict = qos_conflict(heard.topic, publishers, qos) if publishers else ''
            heard.others = [
                other for other, types in self._node.get_topic_names_and_types()
                if _type(kind) in types and other != heard.topic
                and self._node.count_publishers(other)
                and not (seen.node and other.startswith(f'{seen.node}/'))
            ]

    def _of_node(self, name: str, kind: Any) -> str:
        """Return the topic of a type that the localizer hears; a mask has the type of an image."""
        if not name:
            return ''
        space, _, own = name.rpartition('/')
        heard = self._node.get_subscriber_names_and_types_by_node(own, space or '/')
        topics = [topic for topic, types in heard if _type(kind) in types]
        return next((topic for topic in topics if not topic.endswith('mask')), '')

    def _published(self, name: str) -> str:
        space, _, own = name.rpartition('/')
        if not name:
            return ''
        sent = self._node.get_publisher_names_and_types_by_node(own, space or '/')
        return next((topic for topic, types in sent if _type(PoseStamped) in types), '')

    def _qos_of(self, name: str, topic: str) -> QoSProfile | None:
        for one in self._node.get_subscriptions_info_by_topic(topic):
            if name and f'{one.node_namespace.rstrip("/")}/{one.node_name}' == name:
                return one.qos_profile
        return None


def image_type(parameters: Parameters) -> Any:
    """Return the message type of the images (raises ParameterError if it is not installed)."""
    transport = parameters.image_transport
    if transport == 'foxglove':
        return video_type()
    return CompressedImage if transport == 'compressed' else Image


def _kinds(parameters: Parameters) -> dict[str, Any]:
    """Return the message type of each input."""
    return {'image': image_type(parameters), 'camera_info': CameraInfo, 'odom': Odometry}


def _type(kind: Any) -> str:
    package, *_ = str(kind.__module__).split('.')
    return f'{package}/msg/{kind.__name__}'


def _expected(parameters: Parameters, role: str) -> QoSProfile:
    """Return the QoS of a subscription of a localizer with these parameters."""
    reliable = role == 'image' and parameters.image_reliability == 'reliable'
    return QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE if reliable else
                      ReliabilityPolicy.BEST_EFFORT)
