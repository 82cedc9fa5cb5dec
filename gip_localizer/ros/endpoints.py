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
"""Longest time (s) that a reliable reader is waited for."""
UNACKNOWLEDGED = 2.0
"""Time (s) for best-effort readers: a busy machine gives each process its turn within it."""
POLICIES = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY,
            QoSPolicyKind.DURABILITY)
"""Of the quality of service that parameters override."""
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DISCOVERED = 0.5
"""Seconds between two looks for publishers that latch."""
SEEN = 10
"""Messages that are remembered: two subscriptions hear the same one soon after each other."""
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
    Subscribe likewise, and hear what was latched before this node came.

    A transient-local subscription hears no volatile publisher, and both sides log that; a volatile
    one hears both, from now on. So the former is made as soon as a transient-local publisher is
    there, and what is sent to both subscriptions is used once.

    """
    seen: deque[int] = deque(maxlen=SEEN)

    def take(message: Any, info: Mapping[str, int]) -> None:
        if info['source_timestamp'] not in seen:
            seen.append(info['source_timestamp'])
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
    """Return a topic's name as it was resolved, and why none of its publishers may be heard."""
    resolved = node.resolve_topic_name(topic)
    found = node.get_publishers_info_by_topic(resolved)
    if not found:
        return f'nothing publishes {resolved}; is the topic remapped?'
    if conflict := qos_conflict(resolved, found, qos):
        return conflict
    silent = 'none sends' if len(found) > 1 else 'which sends nothing'
    return f'{_count(resolved, found)}, {silent}'


def qos_conflict(topic: str, publishers: Sequence[TopicEndpointInfo], qos: QoSProfile) -> str:
    """Return why a subscription hears none of a topic's publishers; empty: it hears one."""
    if any(qos_check_compatible(one.qos_profile, qos)[0] != QoSCompatibility.ERROR
           for one in publishers):
        return ''
    offered = {f'{one.qos_profile.reliability.name.lower()}, '
               f'{one.qos_profile.durability.name.lower()}' for one in publishers}
    return (f'{_count(topic, publishers)}, none compatible: offered '
            f'{" and ".join(sorted(offered))}, asked for {qos.reliability.name.lower()}, '
            f'{qos.durability.name.lower()}')


def _count(topic: str, publishers: Sequence[TopicEndpointInfo]) -> str:
    return f'{len(publishers)} publisher{"s" if len(publishers) > 1 else ""} of {topic}'


def namesakes(node: Node) -> str:
    """Say how many nodes have this node's full name, where it is not the only one."""
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
    Wait until readers have what was published: a process that ends takes away what they have not.

    Reliable readers acknowledge. A best-effort one does not, and reads from this process's shared
    memory; one whose process was stopped until the writer had gone lost the last image in 2 of 6
    runs, and in none where the writer stayed.

    """
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=ACKNOWLEDGED))
    time.sleep(UNACKNOWLEDGED)


class Endpoints:
    """Remembers which endpoints a node has, so that later ones can be taken away again."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._kept = {kind: set(getattr(node, f'{kind}s')) for kind in KINDS}

    def remove_later_ones(self) -> None:
        """Destroy what was made since."""
        for kind, kept in self._kept.items():
            destroy = getattr(self._node, f'destroy_{kind}')
            for endpoint in set(getattr(self._node, f'{kind}s')) - kept:
                destroy(endpoint)
