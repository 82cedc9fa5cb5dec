# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
/tf and /tf_static, if their message package is installed; the only module that uses tf2_msgs.

Only the message is needed: `session.camera_mount` looks the camera up, and map to odom is computed
from a pose and the odometry at its stamp.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import ParameterError
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters import Camera
from gip_localizer.ros.conversions import header_of, pose_of

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # not part of the wheels or of a minimal ROS installation
    TFMessage = None

NS = 1_000_000_000
"""Nanoseconds per second."""
OWN = 200
"""Number of stored stamps of own transforms, which are also received on /tf; chosen."""


def require_transforms(parameter: str) -> None:
    """
    Check that transforms can be published and received.

    Raises
    ------
    ParameterError
        tf2_msgs is not installed.

    """
    if TFMessage is None:
        raise ParameterError(
            f'parameter {parameter}: is true, but TF is unavailable: the package tf2_msgs is not '
            'installed (apt install ros-jazzy-tf2-msgs, or build it); expected false without it'
        )


class MapToOdom:
    """
    Publishes the transform from odom to map, post-dated so that it is valid until the next.

    Parameters
    ----------
    node : Node
        Publishes.
    map_frame, odom_frame : str
        Of the transform.
    contested : callable
        Called with the name of the transform if another node publishes it too.

    """

    def __init__(
        self, node: Node, map_frame: str, odom_frame: str, contested: Callable[[str], None]
    ) -> None:
        require_transforms('tf.publish')
        self._frames = (map_frame, odom_frame)
        self._contested = contested
        self._publisher = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))
        node.create_subscription(TFMessage, '/tf', self._listen, QoSProfile(depth=10), raw=True)
        self._last: TransformStamped | None = None
        self._stamp_ns = self._sent_ns = 0
        self._own: deque[int] = deque(maxlen=OWN)

    def publish(
        self, stamp_ns: int, now_ns: int, tolerance: float, base: Pose2, odometry: Pose2
    ) -> None:
        """
        Publish one transform.

        Parameters
        ----------
        stamp_ns, now_ns : int
            Stamp of the image, and time of the node's clock, nanoseconds.
        tolerance : float
            Post-dating, seconds.
        base, odometry : Pose2
            Base in map, and base in odom, at the stamp.

        """
        pose = pose_of(base @ odometry.inverse())
        message = TransformStamped(child_frame_id=self._frames[1])
        at = message.transform.translation
        at.x, at.y, at.z = pose.position.x, pose.position.y, 0.0
        message.transform.rotation = pose.orientation
        self._last, self._stamp_ns, self._sent_ns = message, stamp_ns, now_ns
        self._send(stamp_ns + round(tolerance * NS))

    def repeat(self, now_ns: int, tolerance: float, hold: float) -> bool:
        """Publish the last transform again with a new stamp; return whether it is still valid."""
        elapsed = now_ns - self._sent_ns
        if self._last is None or not 0 <= elapsed <= round(hold * NS):
            return False
        if elapsed:
            self._send(self._stamp_ns + elapsed + round(tolerance * NS))
        return True

    def _send(self, stamp_ns: int) -> None:
        assert self._last is not None
        self._own.append(stamp_ns)
        self._last.header = header_of(stamp_ns, self._frames[0])
        self._publisher.publish(TFMessage(transforms=[self._last]))

    def _listen(self, serialized: bytes) -> None:
        """Detect the same transform from another node; most messages need no decoding."""
        if self._frames[1].encode() not in serialized:
            return
        for one in deserialize_message(serialized, TFMessage).transforms:
            frames = (one.header.frame_id.lstrip('/'), one.child_frame_id.lstrip('/'))
            if frames == self._frames and stamp_ns(one.header) not in self._own:
                self._contested(' to '.join(frames))


class StaticCamera:
    """
    Publishes the pose of a camera on /tf_static; does nothing without tf2_msgs.

    Parameters
    ----------
    node : Node
        Publishes.
    base, optical : str
        Frames of the vehicle, and of the camera (z forward, x right, y down).

    """

    def __init__(self, node: Node, base: str, optical: str) -> None:
        self._node, self._frames = node, (base, optical)
        self._publisher = None
        if TFMessage is not None:
            latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
            self._publisher = node.create_publisher(TFMessage, '/tf_static', latched)

    def place(self, camera: Camera) -> None:
        """Publish a new pose of the camera."""
        if self._publisher is None:
            return
        base, optical = self._frames
        held = Extrinsics(camera.x, camera.y, camera.z, camera.roll, camera.pitch, camera.yaw)
        now = int(self._node.get_clock().now().nanoseconds)
        message = TransformStamped(header=header_of(now, base), child_frame_id=optical)
        at, turned = message.transform.translation, message.transform.rotation
        at.x, at.y, at.z = (float(value) for value in held.position())
        quaternion = Rotation.from_matrix(held.rotation()).as_quat()
        turned.x, turned.y, turned.z, turned.w = (float(value) for value in quaternion)
        self._publisher.publish(TFMessage(transforms=[message]))


def follow(node: Node, take: Callable[[Any], None]) -> None:
    """
    Subscribe to /tf_static and to /tf, because a camera mount may move.

    Raises
    ------
    ParameterError
        tf2_msgs is not installed.

    """
    require_transforms('camera.from_tf')
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(TFMessage, '/tf_static', take, latched)
    node.create_subscription(TFMessage, '/tf', take, QoSProfile(depth=100))
