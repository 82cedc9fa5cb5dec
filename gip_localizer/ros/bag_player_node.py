# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `bag_player`: plays a bag into the graph, in the bag's own time on `/clock`."""

from __future__ import annotations

from collections.abc import Sequence
import importlib
import os
import sys
import time
from typing import Any

from builtin_interfaces.msg import Time
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock as ClockMessage

from gip_localizer.errors import BagError, ParameterError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.playback import Playback
from gip_localizer.io.bags.source import BagMessage, Topic
from gip_localizer.io.bags.topics import CAMERA_INFO
from gip_localizer.parameters.integration import BagPlayerParameters
from gip_localizer.ros.conversions import time_of
from gip_localizer.ros.endpoints import advertise, wait_for_delivery
from gip_localizer.ros.listener_wait import ListenerWait
from gip_localizer.ros.middleware import image_environment
from gip_localizer.ros.parameters import LiveParameters
from gip_localizer.ros.player_services import serve
from gip_localizer.ros.running import run_node

NS = 1_000_000_000
"""Nanoseconds per second."""
TICK = 0.002
"""Period (s) of the timer that publishes due messages; chosen."""
CLOCK_STEP_NS = 10_000_000
"""Largest step (ns) of `/clock`, in bag time; chosen: 100 Hz at normal speed."""
LATCHED = ('tf_static',)
"""Last parts of the names of topics that are latched where no quality of service was recorded."""
DEPTH, LATCHED_DEPTH, MOST_DEPTH = 10, 100, 1000
"""Messages that are kept for subscribers: at least, of a latched topic, and at most; chosen."""
AHEAD_NS = NS
"""Bag time (ns) until which the first camera_info is also sent ahead; chosen."""
EXAMPLE = '-p bag:=bags/demo -p wait_for:=/image/compressed,/camera_info,/odom'


class BagPlayerNode(Node):
    """
    Publishes the recorded bytes of every topic whose type is known.

    Attributes
    ----------
    paused : bool
        Nothing is published but by `step`.

    Raises
    ------
    GipError
        A parameter or the bag cannot be used.

    """

    def __init__(self) -> None:
        super().__init__('bag_player')
        self._live = LiveParameters(self, BagPlayerParameters, self._retune)
        settings = self._live.value
        if not settings.bag:
            raise ParameterError(
                'parameter bag: is empty, expected a bag; start with: --ros-args -p bag:=PATH'
            )
        self._bag = Bag([settings.bag])
        self._senders = self._advertise(settings.topics)
        self._time_publisher = self.create_publisher(ClockMessage, '/clock', 10)
        self._start = settings.start
        self._playback = Playback(self._bag, self._senders, self._start_ns())
        self.paused = settings.paused
        self._listeners = ListenerWait(self._to_wait_for(settings.wait_for), self._announce)
        self._begin()
        serve(self, self)
        self.create_timer(TICK, self._play, clock=Clock(clock_type=ClockType.STEADY_TIME))
        for note in self._bag.notes:
            self.get_logger().warning(note)
        self.get_logger().info(f'playing {settings.bag}: {", ".join(self._senders)}')

    def _start_ns(self) -> int:
        return self._bag.start_ns + round(self._live.value.start * NS)

    def _retune(self, settings: BagPlayerParameters) -> None:
        """Go where `start` points, if that has changed."""
        if settings.start != self._start and not self.seek(self._start_ns()):
            self.get_logger().error(f'start: {settings.start:g} s is beyond the end of the bag')
        self._start = settings.start

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
                senders[topic.name] = advertise(self, kind, topic.name, _qos(topic))
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

    def _announce(self) -> None:
        """Send time and calibrations ahead, so that the first frame finds all prepared."""
        now_ns = self._playback.now_ns
        self._time_publisher.publish(ClockMessage(clock=time_of(now_ns)))
        infos = [topic.name for topic in self._bag.topics
                 if topic.msgtype in CAMERA_INFO and topic.name in self._senders]
        sent = set()
        for message in self._bag.messages(infos, now_ns, now_ns + AHEAD_NS):
            if message.topic not in sent:
                sent.add(message.topic)
                self._senders[message.topic].publish(bytes(message.raw))

    def _begin(self) -> None:
        """Publish what was latched before the position, and let the time run from now on."""
        self._told_ns = -CLOCK_STEP_NS
        self._last_tick = time.monotonic_ns()
        latched = {topic.name for topic in self._bag.topics
                   if topic.name in self._senders and _latches(topic)}
        for message in self._playback.before(latched) if latched else ():
            self._senders[message.topic].publish(bytes(message.raw))

    def _play(self) -> None:
        """Publish the due messages, and the clock before each."""
        tick = time.monotonic_ns()
        elapsed, self._last_tick = tick - self._last_tick, tick
        if self.paused or not self._listeners.over():
            return
        for message in self._playback.advance(round(elapsed * self._live.value.rate)):
            self._send(message)
        self._tell_time(self._playback.now_ns)
        if self._playback.ended:
            self._end()

    def _send(self, message: BagMessage) -> None:
        self._tell_time(message.log_ns)
        self._senders[message.topic].publish(bytes(message.raw))

    def _tell_time(self, now_ns: int) -> None:
        if not 0 <= now_ns - self._told_ns < CLOCK_STEP_NS:
            self._told_ns = now_ns
            stamp: Time = time_of(now_ns)
            self._time_publisher.publish(ClockMessage(clock=stamp))

    def _end(self) -> None:
        if self._live.value.loop:
            self.seek(self._start_ns())
            return
        self.get_logger().info('end of the bag')
        self.stop()

    def step(self) -> bool:
        """Publish the next message, while paused; return whether there was one."""
        message = self._playback.step() if self.paused else None
        if message is not None:
            self._send(message)
        return message is not None

    def seek(self, log_ns: int) -> bool:
        """Go to a log time; return whether it lies in the bag."""
        if not self._playback.seek(log_ns):
            return False
        self._tell_time(self._playback.now_ns)
        return True

    def set_rate(self, rate: float) -> bool:
        """Play faster or slower; return whether the rate can be used."""
        [result] = self.set_parameters([Parameter('rate', value=rate)])
        return bool(result.successful)

    def rate(self) -> float:
        """Return bag seconds per second."""
        return self._live.value.rate

    def stop(self) -> None:
        """End once everyone has what was published."""
        wait_for_delivery(self._senders.values())
        rclpy.try_shutdown()


def _names(listed: str) -> list[str]:
    return [name.strip() for name in listed.split(',') if name.strip()]


def _message_type(name: str) -> Any | None:
    """Return a message class by a name like std_msgs/msg/String; None if it is not installed."""
    package, _, kind = name.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), kind, None)
    except ImportError:
        return None


def _latches(topic: Topic) -> bool:
    """Whether a topic was offered transient local, or must be where nothing was recorded."""
    if not topic.offered:
        return topic.name.rsplit('/', 1)[-1] in LATCHED
    return any(offer.latched for offer in topic.offered)


def _qos(topic: Topic) -> QoSProfile:
    """Offer what was recorded; of several publishers what suits most subscribers."""
    latched = _latches(topic)
    depth = max([LATCHED_DEPTH if latched else DEPTH, *(offer.depth for offer in topic.offered)])
    qos = QoSProfile(depth=min(depth, MOST_DEPTH))
    if topic.offered and not any(offer.reliable for offer in topic.offered):
        qos.reliability = ReliabilityPolicy.BEST_EFFORT
    if latched:
        qos.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return qos


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit code is 0 after the end of the bag or an orderly stop."""
    # Fast DDS reads this when the node joins the graph: large images need it.
    os.environ.update(image_environment())
    return run_node(BagPlayerNode, 'bag_player', args, example=EXAMPLE)


if __name__ == '__main__':
    sys.exit(main())
