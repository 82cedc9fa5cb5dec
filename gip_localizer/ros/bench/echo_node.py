# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Latency of the middleware alone: a subscriber that answers each image with its stamp."""

from __future__ import annotations

from collections.abc import Sequence
import sys

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from sensor_msgs.msg import Image

from gip_localizer.io.cdr import image_of
from gip_localizer.io.messages import stamp_ns
from gip_localizer.ros.conversions import header_of
from gip_localizer.ros.running import run_node

NAME = 'bench_echo'


class BenchEcho(Node):
    """Receives images with the same QoS as the localizer, and only answers them."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self._echo = self.create_publisher(PoseStamped, 'echo', QoSProfile(depth=10))
        newest = QoSProfile(depth=1, reliability=qos_profile_sensor_data.reliability)
        self.create_subscription(Image, 'image', self._on_image, newest, raw=True)

    def _on_image(self, serialized: bytes) -> None:
        stamp = stamp_ns(image_of(serialized, 'Image').header)
        self._echo.publish(PoseStamped(header=header_of(stamp, 'camera')))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    return run_node(BenchEcho, NAME, args)


if __name__ == '__main__':
    sys.exit(main())
