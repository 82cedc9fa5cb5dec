# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Everything the node `localizer` listens to."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.guard import fault_of
from gip_localizer.errors import ImageError
from gip_localizer.parameters import Parameters
from gip_localizer.ros.endpoints import listen
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.mask_sync import Masked, MaskPairing

try:
    from gip_localizer.io.cdr import image_of
except ImportError:  # without rosbags, rclpy unpacks images, at the price of its copies
    image_of = None  # type: ignore[assignment]

ODOMETRY_KEPT = 1000
"""Messages that may wait while a frame is localized; older ones are dropped."""
MASKS_KEPT = 5
"""Masks that may wait while a frame is localized."""
LOOK = 0.01
"""Seconds between two looks for images whose mask is overdue."""
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
    when_free : callable
        Does what touches the frontend, now or when the frame in work is done.

    """

    def __init__(
        self, node: Node, frontend: Frontend, on_frame: Callable[[Localize, Any], None],
        on_other: Callable[[str, Any], None], when_free: Callable[..., None],
    ) -> None:
        self._frontend = frontend
        self._when_free = when_free
        self._log = node.get_logger().error
        self._on_frame, self._on_other = on_frame, on_other
        # Before the image: of messages that wait, the executor takes them in this order.
        listen(node, CameraInfo, 'camera_info', self._take_camera_info, qos_profile_sensor_data)
        self._pairing: MaskPairing | None = None
        if frontend.parameters.mask.from_topic:
            self._listen_to_masks(node, frontend.parameters)
        self._listen_to_images(node, frontend.parameters)
        self._odometry = listen(node, Odometry, 'odom', self._take_odometry, QoSProfile(
            depth=ODOMETRY_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT
        ))  # fmt: skip
        listen(node, PoseWithCovarianceStamped, 'initialpose', self._take_initial_pose,
               QoSProfile(depth=1))

    @property
    def overtaken(self) -> int:
        """Images that a newer one with its mask overtook."""
        return 0 if self._pairing is None else self._pairing.dropped

    def _listen_to_images(self, node: Node, parameters: Parameters) -> None:
        self._decode: Callable[..., Estimate] = self._frontend.on_image
        kind, topic = Image, 'image'
        if parameters.image_transport == 'compressed':
            self._decode = self._frontend.on_compressed_image
            kind, topic = CompressedImage, 'image/compressed'
        self._listen_for(node, kind, topic, self._take_image, _camera_qos(parameters, depth=1))

    def _listen_to_masks(self, node: Node, parameters: Parameters) -> None:
        self._pairing = MaskPairing(lambda: self._frontend.parameters.mask)
        qos = _camera_qos(parameters, depth=MASKS_KEPT)
        self._listen_for(node, Image, 'mask', self._take_mask, qos)
        node.create_timer(LOOK, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _listen_for(
        self, node: Node, kind: type[Any], topic: str, take: Callable[[Any], None],
        qos: QoSProfile,
    ) -> None:
        """Subscribe to images or masks, whose pixels are not copied."""
        if image_of is None:
            listen(node, kind, topic, take, qos)
            return

        def unpack(serialized: bytes) -> None:
            try:
                message = image_of(serialized, kind.__name__)
            except ImageError as error:
                node.get_logger().error(f'{topic}: {error}', throttle_duration_sec=1.0)
            else:
                take(message)

        image_of(serialize_message(kind()), kind.__name__)  # builds the types: 0.2 s, once
        listen(node, kind, topic, unpack, qos, raw=True)

    def _take_image(self, message: Any) -> None:
        if self._pairing is None:
            self._localize(self._decode, message)
            return
        self._hand_on(self._pairing.add_image(message, time.monotonic_ns()))

    def _take_mask(self, message: Any) -> None:
        if self._pairing is not None:
            self._hand_on(self._pairing.add_mask(message))

    def _look(self) -> None:
        if self._pairing is not None:
            *older, newest = [None, *self._pairing.overdue(time.monotonic_ns())]
            self._pairing.dropped += max(len(older) - 1, 0)
            self._hand_on(newest)

    def _hand_on(self, masked: Masked | None) -> None:
        if masked is not None:
            self._localize(partial(self._decode, masked=masked), masked.image)

    def _localize(self, localize: Localize, message: Any) -> None:
        """Hand a frame on; of those that come during a search only the newest."""
        self._when_free(partial(self._on_frame, localize, message), instead_of='image')

    def take_waiting_odometry(self) -> None:
        """Take what the executor has not come to yet: it may hand an image out first."""
        handle = self._odometry.handle
        with handle:
            while (taken := handle.take_message(Odometry, False)) is not None:
                self._take_odometry(taken[0])

    def _take_camera_info(self, message: CameraInfo) -> None:
        self._take(self._frontend.on_camera_info, 'camera_info', message)

    def _take_odometry(self, message: Odometry) -> None:
        self._take(self._frontend.on_odometry, 'odom', message)

    def _take_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        self._take(self._frontend.on_initial_pose, 'initialpose', message)

    def _take(self, use: Callable[[Any], None], topic: str, message: Any) -> None:
        def take() -> None:
            if told := fault_of(partial(use, message), self._log):
                self._frontend.complaints[topic] = told
            self._on_other(topic, message)

        self._when_free(take)


def _camera_qos(parameters: Parameters, depth: int) -> QoSProfile:
    qos = QoSProfile(depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
    if parameters.image_reliability == 'reliable':
        qos.reliability = ReliabilityPolicy.RELIABLE
    return qos
