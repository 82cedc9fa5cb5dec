# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Topics whose quality of service the user may override by parameters."""

from __future__ import annotations

from collections.abc import Callable
import copy
from typing import Any, TypeVar

from rclpy.exceptions import ParameterException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.subscription import Subscription

from gip_localizer.errors import ParameterError

Made = TypeVar('Made')
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
