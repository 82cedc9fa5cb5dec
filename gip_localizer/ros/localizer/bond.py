# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The bond by which nav2's lifecycle manager notices that an active node has died.

Both sides publish a Status with the name of the node on the topic `bond`, each under an instance
of its own: active while they live, and not active to part. Timeouts are those of bondcpp.

"""

from __future__ import annotations

import time
from typing import Any
import uuid

from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from gip_localizer.ros.conversions import time_of

try:
    from bond.msg import Status
except ImportError:  # neither in the wheels nor in a plain install of ROS
    Status = None

AVAILABLE = Status is not None
TOPIC = 'bond'
CONNECT_TIMEOUT = 10.0
"""Time (s) after which a bond without another side ends (bondcpp's default)."""
HEARTBEAT_TIMEOUT = 4.0
"""Silence (s) after which the other side is taken for dead (the default of bondcpp and nav2)."""
KEPT_SENT, KEPT_HEARD = 5, 100
"""Messages that are kept for sending and for hearing, as bondcpp does."""
MISSING = (
    'no bond: the package bond is not installed (apt install ros-jazzy-bond); set bond_timeout: '
    "0.0 for nav2's lifecycle manager"
)


class Bond:
    """
    One side of a bond.

    Parameters
    ----------
    node : Node
        Its name is that of the bond.
    period : float
        Time between two messages, seconds.

    """

    def __init__(self, node: Node, period: float) -> None:
        self._node, self._period = node, period
        self._own = str(uuid.uuid4())
        self._formed = self._ended = False
        self._heard = time.monotonic()
        self._publisher = node.create_publisher(Status, TOPIC, QoSProfile(depth=KEPT_SENT))
        self._subscription = node.create_subscription(
            Status, TOPIC, self._hear, QoSProfile(depth=KEPT_HEARD)
        )
        self._timer = node.create_timer(
            period, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._publish(active=True)

    def close(self) -> None:
        """Announce the end of the bond to the other side, and leave the topic."""
        self._end()
        self._node.destroy_timer(self._timer)
        self._node.destroy_subscription(self._subscription)
        self._node.destroy_publisher(self._publisher)

    def _hear(self, status: Any) -> None:
        if status.id != self._node.get_name() or status.instance_id == self._own:
            return
        if status.active:
            self._formed, self._heard = True, time.monotonic()
        else:
            self._end()

    def _tick(self) -> None:
        silence = time.monotonic() - self._heard
        if silence <= (HEARTBEAT_TIMEOUT if self._formed else CONNECT_TIMEOUT):
            self._publish(active=True)
            return
        if self._formed:
            self._node.get_logger().warning(
                f'bond: the lifecycle manager was silent for {HEARTBEAT_TIMEOUT:g} s'
            )
        self._end()

    def _end(self) -> None:
        if not self._ended:
            self._ended = True
            self._timer.cancel()
            self._publish(active=False)

    def _publish(self, *, active: bool) -> None:
        self._publisher.publish(Status(
            header=Header(stamp=time_of(time.monotonic_ns())), id=self._node.get_name(),
            instance_id=self._own, active=active, heartbeat_timeout=HEARTBEAT_TIMEOUT,
            heartbeat_period=self._period,
        ))  # fmt: skip
