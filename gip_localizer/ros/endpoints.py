# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics whose quality of service the user may override by parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import copy
import time
from typing import Any, TypeVar

from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from gip_localizer.errors import ParameterError

Made = TypeVar('Made')
ACKNOWLEDGED = 1.0
"""Longest time (s) that a reliable reader is waited for."""
UNACKNOWLEDGED = 2.0
"""Time (s) for best-effort readers: a busy machine gives each process its turn within it."""
KINDS = ('publisher', 'subscription', 'service', 'timer')


def listen(
    node: Node, kind: type[Any], topic: str, use: Callable[[Any], None], qos: QoSProfile, *,
    raw: bool = False,
) -> Subscription:
    """
    Subscribe, with `qos_overrides./TOPIC.subscription.{history,depth,reliability}` over `qos`.

    With `raw`, messages come as serialized bytes.

    Raises
    ------
    ParameterError
        An override is of the wrong type, or no such policy.

    """
    return _overridable(topic, lambda options: node.create_subscription(
        kind, topic, use, copy.copy(qos), qos_overriding_options=options, raw=raw
    ))  # fmt: skip


def advertise(node: Node, kind: type[Any], topic: str, qos: QoSProfile) -> Publisher:
    """
    Advertise, with `qos_overrides./TOPIC.publisher.{history,depth,reliability}` over `qos`.

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
        return make(QoSOverridingOptions.with_default_policies())
    except (ParameterException, RuntimeError, ValueError) as error:
        raise ParameterError(
            f'parameters qos_overrides of the topic {topic}: {error}; expected history keep_last '
            'or keep_all, depth an integer, reliability best_effort or reliable'
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
