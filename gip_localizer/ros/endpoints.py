# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics whose quality of service the user may override by parameters."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
import copy
import time
from typing import Any, TypeVar

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    qos_check_compatible,
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
)
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from gip_localizer.errors import ParameterError

Made = TypeVar('Made')
ACKNOWLEDGED = 1.0
"""Longest time (s) to wait for the acknowledgement of reliable readers; chosen."""
UNACKNOWLEDGED = 2.0
"""Time (s) to wait for best-effort readers, also on a busy machine; chosen."""
POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
            QoSPolicyKind.DURABILITY)
"""QoS policies that parameters can override."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""QoS of topics whose last message is sent to later subscribers."""
DISCOVERED = 0.5
"""Period (s) of the search for transient-local publishers; chosen."""
STORED_STAMPS = 10
"""Number of stored stamps for detecting messages received twice; chosen."""
KINDS = ('publisher', 'subscription', 'service', 'timer')


def listen(
    node: Node, kind: type[Any], topic: str, use: Callable[..., None], qos: QoSProfile, *,
    raw: bool = False,
) -> Subscription:
    """
    Subscribe, with `qos_overrides./TOPIC.subscription.{POLICY}` over `qos`.

    With `raw`, messages come as serialized bytes.

    Raises
    ------
    ParameterError
        An override is of the wrong type, or no such policy.

    """
    return _overridable(topic, lambda options: node.create_subscription(
        kind, topic, use, copy.copy(qos), qos_overriding_options=options, raw=raw
    ))  # fmt: skip


def listen_to_latched(
    node: Node, kind: type[Any], topic: str, use: Callable[[Any], None], qos: QoSProfile
) -> None:
    """
    Subscribe in the same way, and also receive a transient-local message sent earlier.

    A transient-local subscription is incompatible with volatile publishers, and both nodes log
    that; a volatile one receives new messages of both. So the former is added when a
    transient-local publisher is discovered, and a message received twice is used once.

    """
    used: deque[int] = deque(maxlen=STORED_STAMPS)

    def take(message: Any, info: Mapping[str, int]) -> None:
        if info['source_timestamp'] not in used:
            used.append(info['source_timestamp'])
            use(message)

    listen(node, kind, topic, take, qos)
    name = node.resolve_topic_name(topic)

    def look() -> None:
        found = (one.qos_profile.durability for one in node.get_publishers_info_by_topic(name))
        if DurabilityPolicy.TRANSIENT_LOCAL in found:
            node.destroy_timer(timer)
            node.create_subscription(kind, topic, take, LATCHED)

    timer = node.create_timer(DISCOVERED, look, clock=Clock(clock_type=ClockType.STEADY_TIME))


def publishers_of(node: Node, topic: str, qos: QoSProfile) -> str:
    """Return the resolved name of a topic, and why no message of it is received."""
    resolved = node.resolve_topic_name(topic)
    found = node.get_publishers_info_by_topic(resolved)
    if not found:
        return f'nothing publishes {resolved}; check the name of the topic'
    if conflict := qos_conflict(resolved, found, qos):
        return conflict
    silent = 'none sends' if len(found) > 1 else 'which sends nothing'
    return f'{_count(resolved, found)}, {silent}'


def qos_conflict(topic: str, publishers: Sequence[TopicEndpointInfo], qos: QoSProfile) -> str:
    """Return why no publisher of a topic is compatible with a subscription, or empty."""
    if any(qos_check_compatible(one.qos_profile, qos)[0] != QoSCompatibility.ERROR
           for one in publishers):
        return ''
    offered = {f'{one.qos_profile.reliability.name.lower()}, '
               f'{one.qos_profile.durability.name.lower()}' for one in publishers}
    return (f'{_count(topic, publishers)}, none compatible: offered '
            f'{" and ".join(sorted(offered))}, requested {qos.reliability.name.lower()}, '
            f'{qos.durability.name.lower()}')


def _count(topic: str, publishers: Sequence[TopicEndpointInfo]) -> str:
    return f'{len(publishers)} publisher{"s" if len(publishers) > 1 else ""} of {topic}'


def namesakes(node: Node) -> str:
    """Return a text with the number of nodes of this name; empty if it is unique."""
    own = (node.get_name(), node.get_namespace())
    count = node.get_node_names_and_namespaces().count(own)
    return f'{count} nodes are called {node.get_fully_qualified_name()}' if count > 1 else ''


def advertise(node: Node, kind: type[Any], topic: str, qos: QoSProfile) -> Publisher:
    """
    Advertise, with `qos_overrides./TOPIC.publisher.{POLICY}` over `qos`.

    Raises
    ------
    ParameterError
        An override is of the wrong type, or no such policy.

    """
    return _overridable(topic, lambda options: node.create_publisher(
        kind, topic, copy.copy(qos), qos_overriding_options=options
    ))  # fmt: skip


def _overridable(topic: str, make: Callable[[QoSOverridingOptions], Made]) -> Made:
    try:
        return make(QoSOverridingOptions(POLICIES))
    except (ParameterException, RuntimeError, ValueError) as error:
        raise ParameterError(
            f'parameters qos_overrides of the topic {topic}: {error}; expected history keep_last '
            'or keep_all, depth an integer, reliability best_effort or reliable, durability '
            'volatile or transient_local'
        ) from None


def wait_for_delivery(publishers: Iterable[Publisher]) -> None:
    """
    Wait until readers have the last messages, which are lost when this process ends.

    Reliable readers acknowledge messages. Best-effort readers do not, and read from the shared
    memory of this process: a delayed reader lost the last image in 2 of 6 runs when the writer
    ended at once, and in none when it waited.

    """
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED))
    time.sleep(UNACKNOWLEDGED)


class Endpoints:
    """Stores the endpoints of a node, so that those added later can be removed again."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._kept = {kind: set(getattr(node, f'{kind}s')) for kind in KINDS}

    def remove_later_ones(self) -> None:
        """Destroy the endpoints that were added since."""
        for kind, kept in self._kept.items():
            destroy = getattr(self._node, f'destroy_{kind}')
            for endpoint in set(getattr(self._node, f'{kind}s')) - kept:
                destroy(endpoint)
