# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything the node `localizer` listens to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from gip_localizer.core.estimate import Estimate
from gip_localizer.io.frontend import Frontend
from gip_localizer.parameters import Parameters
from gip_localizer.ros.endpoints import listen

ODOMETRY_KEPT = 1000
"""Messages that may wait while a frame is localized; older ones are dropped."""
Localize = Callable[[Any], Estimate]


class Inputs:
    """
    The subscriptions of a node.

    Parameters
    ----------
    node : Node
        Listens.
    frontend : Frontend
        Takes the messages.
    on_frame : callable
        Told each image, and what localizes it.
    on_other : callable
        Told the topic and the message after each other message was taken.

    """

    def __init__(
        self, node: Node, frontend: Frontend, on_frame: Callable[[Localize, Any], None],
        on_other: Callable[[str, Any], None],
    ) -> None:
        self._frontend = frontend
        self._on_frame, self._on_other = on_frame, on_other
        # Before the image: of messages that wait, the executor takes them in this order.
        listen(node, CameraInfo, 'camera_info', self._take_camera_info, qos_profile_sensor_data)
        self._listen_to_images(node, frontend.parameters)
        self._odometry = listen(node, Odometry, 'odom', self._take_odometry, QoSProfile(
            depth=ODOMETRY_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT
        ))  # fmt: skip
        listen(node, PoseWithCovarianceStamped, 'initialpose', self._take_initial_pose,
               QoSProfile(depth=1))

    def _listen_to_images(self, node: Node, parameters: Parameters) -> None:
        camera = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        if parameters.image_reliability == 'reliable':
            camera.reliability = ReliabilityPolicy.RELIABLE
        if parameters.image_transport == 'compressed':
            listen(node, CompressedImage, 'image/compressed', lambda message: self._on_frame(
                self._frontend.on_compressed_image, message), camera)
        else:
            listen(node, Image, 'image', lambda message: self._on_frame(
                self._frontend.on_image, message), camera)

    def take_waiting_odometry(self) -> None:
        """Take what the executor has not come to yet: it may hand an image out first."""
        handle = self._odometry.handle
        with handle:
            while (taken := handle.take_message(Odometry, False)) is not None:
                self._take_odometry(taken[0])

    def _take_camera_info(self, message: CameraInfo) -> None:
        self._frontend.on_camera_info(message)
        self._on_other('camera_info', message)

    def _take_odometry(self, message: Odometry) -> None:
        self._frontend.on_odometry(message)
        self._on_other('odom', message)

    def _take_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._frontend.on_initial_pose(message)
        self._on_other('initialpose', message)
