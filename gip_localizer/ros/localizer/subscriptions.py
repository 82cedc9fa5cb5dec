# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The subscriptions of the node `localizer`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from gip_localizer.errors import ImageError, ParameterError
from gip_localizer.io.foxglove_video import packet_of
from gip_localizer.parameters import Parameters
from gip_localizer.ros.endpoints import listen, listen_to_latched, publishers_of
from gip_localizer.session.dispatch import (
    CAMERA_INFO,
    IMAGE,
    INITIAL_POSE,
    MASK,
    ODOMETRY,
)

try:
    from foxglove_msgs.msg import CompressedVideo
except ImportError:  # not in the wheels
    CompressedVideo = None
try:
    from gip_localizer.io.cdr import image_of
except ImportError:  # without rosbags, rclpy decodes images, which takes more copies
    image_of = None  # type: ignore[assignment]

ODOMETRY_KEPT = 1000
"""Depth of the odometry queue while a frame is localized; chosen: seconds at 100 Hz."""
PACKETS_KEPT = 30
"""Packets of a video that wait during a frame: each is needed; a second at 30 Hz."""
MASKS_KEPT = 5
"""Depth of the mask queue while a frame is localized; chosen."""
LOOK = 0.01
"""Period (s) of the check for images whose mask is overdue; chosen."""


class Inputs:
    """
    The subscriptions of a node.

    Parameters
    ----------
    node : Node
        Listens.
    parameters : Parameters
        At the start.
    take : callable
        Takes the role of a message (`gip_localizer.session.dispatch`) and the message.
    look : callable
        Called every `LOOK` seconds if masks are used, for overdue images.

    """

    def __init__(
        self, node: Node, parameters: Parameters, take: Callable[[str, Any], None],
        look: Callable[[], None],
    ) -> None:
        self._node, self._take = node, take
        # Before the image: the executor processes waiting messages in this order.
        listen_to_latched(node, CameraInfo, 'camera_info', partial(take, CAMERA_INFO),
                          qos_profile_sensor_data)
        if parameters.mask.from_topic:
            qos = _camera_qos(parameters, depth=MASKS_KEPT)
            self._listen_for(Image, 'mask', MASK, qos)
            node.create_timer(LOOK, look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        topic, qos = self._listen_for_images(parameters)
        self._awaited = {
            IMAGE: (topic, qos), CAMERA_INFO: ('camera_info', qos_profile_sensor_data),
        }
        self._odometry = listen(node, Odometry, 'odom', partial(take, ODOMETRY), QoSProfile(
            depth=ODOMETRY_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT
        ))  # fmt: skip
        listen_to_latched(node, PoseWithCovarianceStamped, 'initialpose',
                          partial(take, INITIAL_POSE), QoSProfile(depth=1))

    @property
    def image_topic(self) -> str:
        """The topic of the images, with remappings applied."""
        return self._node.resolve_topic_name(self._awaited[IMAGE][0])

    def publisher_hint(self, role: str) -> str:
        """Return topic and publishers of a missing input: IMAGE or CAMERA_INFO."""
        topic, qos = self._awaited[role]
        return publishers_of(self._node, topic, qos)

    def take_waiting_odometry(self) -> None:
        """Process waiting odometry, which the executor may deliver only after an image."""
        handle = self._odometry.handle
        with handle:
            while (taken := handle.take_message(Odometry, False)) is not None:
                self._take(ODOMETRY, taken[0])

    def _listen_for_images(self, parameters: Parameters) -> tuple[str, QoSProfile]:
        """Subscribe to the images; return topic and quality of service."""
        transport = parameters.image_transport
        topic = 'image' if transport == 'raw' else transport_topic(self._node, transport)
        qos = _camera_qos(parameters, depth=PACKETS_KEPT if transport == 'foxglove' else 1)
        if transport != 'foxglove':
            self._listen_for(Image if transport == 'raw' else CompressedImage, topic, IMAGE, qos)
            return topic, qos
        listen(self._node, video_type(), topic,
               lambda message: self._take(IMAGE, packet_of(message)), qos)
        return topic, qos

    def _listen_for(self, kind: type[Any], topic: str, role: str, qos: QoSProfile) -> None:
        """Subscribe to images or masks, whose pixels are not copied."""
        if image_of is None:
            listen(self._node, kind, topic, partial(self._take, role), qos)
            return

        def unpack(serialized: bytes) -> None:
            try:
                message = image_of(serialized, kind.__name__)
            except ImageError as error:
                self._node.get_logger().error(f'{topic}: {error}', throttle_duration_sec=1.0)
            else:
                self._take(role, message)

        image_of(serialize_message(kind()), kind.__name__)  # builds the types: 0.2 s, once
        listen(self._node, kind, topic, unpack, qos, raw=True)


def video_type() -> Any:
    """Return foxglove_msgs/CompressedVideo (raises ParameterError if it is not installed)."""
    if CompressedVideo is None:
        raise ParameterError(
            'parameter image_transport: is foxglove, but the package foxglove_msgs is not '
            'installed (apt install ros-jazzy-foxglove-msgs); expected raw or compressed '
            'without it'
        )
    return CompressedVideo


def transport_topic(node: Node, transport: str) -> str:
    """Return the topic of image_transport: below `image`, unless it is remapped itself."""
    own = f'image/{transport}'
    if node.resolve_topic_name(own) != node.resolve_topic_name(own, only_expand=True):
        return own
    return f'{node.resolve_topic_name("image")}/{transport}'


def _camera_qos(parameters: Parameters, depth: int) -> QoSProfile:
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    if parameters.image_reliability == 'reliable':
        qos.reliability = ReliabilityPolicy.RELIABLE
    return qos
