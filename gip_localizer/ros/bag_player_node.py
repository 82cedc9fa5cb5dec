# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `bag_player`: plays a bag into the graph, in the bag's own time on `/clock`."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import importlib
import os
import sys
import time
from typing import Any

from builtin_interfaces.msg import Time
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import SetBool

from gip_localizer.errors import BagError, ParameterError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.source import BagMessage
from gip_localizer.parameters.integration import BagPlayerParameters
from gip_localizer.ros.conversions import time_of
from gip_localizer.ros.endpoints import wait_for_delivery
from gip_localizer.ros.middleware import image_environment
from gip_localizer.ros.parameters import LiveParameters
from gip_localizer.ros.running import run_node

NS = 1_000_000_000
TICK = 0.002
"""Seconds between two looks at what is due."""
CLOCK_STEP_NS = 10_000_000
"""Largest step of `/clock`, bag time."""
LATCHED = ('/tf_static',)
EXAMPLE = '-p bag:=bags/demo -p wait_for:=/image/compressed,/odom'


class BagPlayerNode(Node):
    """
    Publishes the recorded bytes of every topic whose type is known.

    Raises
    ------
    GipError
        A parameter or the bag cannot be used.

    """

    def __init__(self) -> None:
        super().__init__('bag_player')
        self._live = LiveParameters(self, BagPlayerParameters)
        settings = self._live.value
        if not settings.bag:
            raise ParameterError(
                'parameter bag: is empty, expected a bag; start with: --ros-args -p bag:=PATH'
            )
        self._bag = Bag([settings.bag])
        self._senders = self._advertise(settings.topics)
        self._clock = self.create_publisher(ClockMessage, '/clock', 10)
        self._start_ns = self._bag.start_ns + round(settings.start * NS)
        self._paused = settings.paused
        self._awaited = self._to_wait_for(settings.wait_for)
        self._rewind()
        self.create_service(SetBool, '~/pause', self._on_pause)
        self.create_timer(TICK, self._play, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for note in self._bag.notes:
            self.get_logger().warning(note)
        self.get_logger().info(f'playing {settings.bag}: {", ".join(self._senders)}')

    def _advertise(self, chosen: str) -> dict[str, Publisher]:
        names = _names(chosen)
        recorded = {topic.name for topic in self._bag.topics}
        missing = [name for name in names if name not in recorded]
        if missing:
            raise BagError(
                f'no topic {", ".join(missing)} in the bag; it holds {", ".join(sorted(recorded))}'
            )
        senders = {}
        for topic in self._bag.topics:
            kind = _message_type(topic.msgtype) if self._bag.known(topic) else None
            if kind is not None and topic.name != '/clock' and topic.name in (names or recorded):
                senders[topic.name] = self.create_publisher(kind, topic.name, _qos(topic.name))
        if not senders:
            raise BagError('the bag holds no topic of a known type; see ros2 bag info')
        return senders

    def _to_wait_for(self, chosen: str) -> list[Publisher]:
        names = _names(chosen)
        missing = [name for name in names if name not in self._senders]
        if missing:
            raise ParameterError(
                f'parameter wait_for: {", ".join(missing)} is not played; '
                f'played are {", ".join(sorted(self._senders))}'
            )
        return [self._senders[name] for name in names]

    def _waiting(self) -> bool:
        """Whether a topic still lacks its subscriber; once all have one, never again."""
        if all(sender.get_subscription_count() for sender in self._awaited):
            self._awaited = []
        return bool(self._awaited)

    def _rewind(self) -> None:
        self._messages: Iterator[BagMessage] = self._bag.messages(
            list(self._senders), self._start_ns
        )
        self._next = next(self._messages, None)
        self._now_ns = self._start_ns if self._next is None else self._next.log_ns
        self._told_ns = self._now_ns - CLOCK_STEP_NS
        self._last_tick = time.monotonic_ns()

    def _play(self) -> None:
        """Publish what has become due, with the clock before it."""
        tick = time.monotonic_ns()
        elapsed, self._last_tick = tick - self._last_tick, tick
        if self._paused or self._waiting():
            return
        self._now_ns += round(elapsed * self._live.value.rate)
        while self._next is not None and self._next.log_ns <= self._now_ns:
            self._tell_time(self._next.log_ns)
            self._senders[self._next.topic].publish(bytes(self._next.raw))
            self._next = next(self._messages, None)
        self._tell_time(self._now_ns)
        if self._next is None:
            self._end()

    def _tell_time(self, now_ns: int) -> None:
        if now_ns - self._told_ns >= CLOCK_STEP_NS:
            self._told_ns = now_ns
            stamp: Time = time_of(now_ns)
            self._clock.publish(ClockMessage(clock=stamp))

    def _end(self) -> None:
        if self._live.value.loop:
            self._rewind()
            return
        self.get_logger().info('end of the bag')
        wait_for_delivery(self._senders.values())
        rclpy.try_shutdown()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._paused = bool(request.data)
        response.success = True
        response.message = 'paused' if self._paused else 'playing'
        return response


def _names(listed: str) -> list[str]:
    return [name.strip() for name in listed.split(',') if name.strip()]


def _message_type(name: str) -> Any | None:
    """Return a message class by a name like std_msgs/msg/String; None if it is not installed."""
    package, _, kind = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), kind, None)
    except ImportError:
        return None


def _qos(topic: str) -> QoSProfile:
    """Offer reliable delivery, which suits every subscriber; latched where late comers need it."""
    if topic in LATCHED:
        return QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return QoSProfile(depth=10)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit code is 0 after the end of the bag or an orderly stop."""
    # Fast DDS reads this when the node joins the graph: large images need it.
    os.environ.update(image_environment())
    return run_node(BagPlayerNode, 'bag_player', args, example=EXAMPLE)


if __name__ == '__main__':
    sys.exit(main())
