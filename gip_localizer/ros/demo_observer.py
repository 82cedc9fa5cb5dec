# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A node of the demo that receives and stores poses, ground truth and images."""

from __future__ import annotations

from collections.abc import Callable
import time
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
import numpy as np
from numpy.typing import NDArray
import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image

from gip_localizer.evaluation.demo import ReceivedMessages
from gip_localizer.evaluation.run import FrameExhibit
from gip_localizer.io.messages import planar_pose, stamp_ns

PICTURES = {
    'image': 'camera image',
    'localizer/overlay': 'the map drawn into the camera image',
    'localizer/comparison': "bird's-eye view, map at the matched pose, and both (dark blue: not "
                            'seen, or not on the map)',
}
KEPT_FRAMES = 3
"""Number of frames that wait for all their images; chosen, to bound the memory."""
SHOWN = 3
"""Number of frames that the report shows; chosen."""


class DemoObserver:
    """
    Listens to a synthetic camera and a localizer; use as a context manager.

    Attributes
    ----------
    received : ReceivedMessages
        Messages received so far.

    """

    def __init__(self) -> None:
        self.received = ReceivedMessages()
        self._pictures: dict[int, dict[str, NDArray[Any]]] = {}
        self._complete: dict[int, dict[str, NDArray[Any]]] = {}
        self._completed = 0

    def __enter__(self) -> DemoObserver:
        """Join the graph."""
        # The demo handles Ctrl-C itself, because it must end its child processes first.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        self._node = Node('demo', enable_rosout=False, start_parameter_services=False)
        reliable = QoSProfile(depth=100)
        listen = self._node.create_subscription
        listen(PoseStamped, 'ground_truth', self._on_truth, reliable)
        listen(PoseWithCovarianceStamped, 'pose_with_covariance', self._on_pose, reliable)
        listen(DiagnosticArray, '/diagnostics', self._on_diagnostics, reliable)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self._node)
        return self

    def __exit__(self, *_: object) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown()

    def listen_for(self, seconds: float) -> None:
        """Process messages for some seconds."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0.0:
            try:
                self._executor.spin_once(timeout_sec=left)
            except ExternalShutdownException:
                return

    def look(self) -> None:
        """Subscribe to the images too."""
        for topic in PICTURES:
            self._node.create_subscription(
                Image, topic, self._keeper(topic), qos_profile_sensor_data
            )

    def exhibits(self) -> list[FrameExhibit]:
        """Return the frames with the largest errors among those with all images."""
        return [
            FrameExhibit(
                self._title(stamp), stamp,
                {caption: self._complete[stamp][topic] for topic, caption in PICTURES.items()},
                f'Rank {rank} of {self._completed} frames by position error, of those whose '
                'pictures all arrived.',
            )
            for rank, stamp in enumerate(self._by_error()[:SHOWN], start=1)
        ]

    def _by_error(self) -> list[int]:
        """Return the stamps of complete pictures, the largest error first."""
        errors = {stamp: self.received.error_m(stamp) or 0.0 for stamp in self._complete}
        return sorted(errors, key=lambda stamp: (-errors[stamp], stamp))

    def _title(self, stamp: int) -> str:
        stamps = sorted(self.received.truth)
        error = self.received.error_m(stamp)
        seconds = (stamp - stamps[0]) * 1e-9 if stamps else 0.0
        words = 'no pose' if error is None else f'error {1e3 * error:.1f} mm'
        return f'Frame at {seconds:.2f} s: {words}'

    def _keep_worst(self, stamp: int, pictures: dict[str, NDArray[Any]]) -> None:
        """Store the images of a frame; of too many frames, remove that with the least error."""
        self._complete[stamp] = pictures
        self._completed += 1
        if len(self._complete) > SHOWN + KEPT_FRAMES:
            settled = sorted(self._complete)[:-KEPT_FRAMES]
            del self._complete[[s for s in self._by_error() if s in settled][-1]]

    def _on_truth(self, message: PoseStamped) -> None:
        self.received.truth[stamp_ns(message.header)] = planar_pose(message.pose)

    def _on_pose(self, message: PoseWithCovarianceStamped) -> None:
        stamp = stamp_ns(message.header)
        latency_ms = (self._node.get_clock().now().nanoseconds - stamp) * 1e-6
        full = np.asarray(message.pose.covariance).reshape(6, 6)
        covariance = full[np.ix_((0, 1, 5), (0, 1, 5))]
        self.received.poses[stamp] = (planar_pose(message.pose.pose), covariance, latency_ms)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        output = [status for status in message.status if status.name.endswith(': output')]
        if not output:
            return
        said = (stamp_ns(message.header), output[0].message)
        if not self.received.diagnostics or self.received.diagnostics[-1][1] != said[1]:
            self.received.diagnostics.append(said)

    def _keeper(self, topic: str) -> Callable[[Image], None]:
        def keep(message: Image) -> None:
            stamp = stamp_ns(message.header)
            pictures = self._pictures.setdefault(stamp, {})
            pictures[topic] = _pixels(message)
            if len(pictures) == len(PICTURES):
                self._keep_worst(stamp, pictures)
            for old in sorted(self._pictures)[:-KEPT_FRAMES]:
                del self._pictures[old]

        return keep


def _pixels(message: Image) -> NDArray[Any]:
    """Return mono8 (h, w) or bgr8 as RGB (h, w, 3): what the camera and the node send here."""
    channels = 3 if message.encoding == 'bgr8' else 1
    rows = np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)
    pixels = rows[:, : message.width * channels].reshape(message.height, message.width, channels)
    return pixels[:, :, ::-1].copy() if channels == 3 else pixels[:, :, 0].copy()
