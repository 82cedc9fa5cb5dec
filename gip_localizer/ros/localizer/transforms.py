# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
/tf and /tf_static, where their message is installed; the only module that knows of tf2.

No more than the message is needed: the camera is looked up by `session.camera_mount`, and map to
odom follows from a pose and the odometry at its stamp.

"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from gip_localizer.core.pose import Pose2
from gip_localizer.errors import ParameterError
from gip_localizer.ros.conversions import header_of, pose_of

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # neither in the wheels nor in a plain install of rclpy
    TFMessage = None

NS = 1_000_000_000


def require_transforms(parameter: str) -> None:
    """
    Make sure that transforms can be sent and heard.

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
    """Publishes the transform from odom to map, stamped ahead so that it holds until the next."""

    def __init__(self, node: Node, map_frame: str, odom_frame: str) -> None:
        require_transforms('tf.publish')
        self._frames = (map_frame, odom_frame)
        self._publisher = node.create_publisher(TFMessage, '/tf', QoSProfile(depth=100))

    def publish(self, stamp_ns: int, tolerance: float, base: Pose2, odometry: Pose2) -> None:
        """
        Publish one transform.

        Parameters
        ----------
        stamp_ns : int
            Of the image.
        tolerance : float
            How far ahead it is stamped, seconds.
        base, odometry : Pose2
            Base in map, and base in odom, at the stamp.

        """
        pose = pose_of(base @ odometry.inverse())
        header = header_of(stamp_ns + round(tolerance * NS), self._frames[0])
        message = TransformStamped(header=header, child_frame_id=self._frames[1])
        at = message.transform.translation
        at.x, at.y, at.z = pose.position.x, pose.position.y, 0.0
        message.transform.rotation = pose.orientation
        self._publisher.publish(TFMessage(transforms=[message]))


def follow(node: Node, take: Callable[[Any], None]) -> None:
    """
    Hear /tf_static and /tf: a camera may hang on a mount that moves.

    Raises
    ------
    ParameterError
        tf2_msgs is not installed.

    """
    require_transforms('camera.from_tf')
    latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    node.create_subscription(TFMessage, '/tf_static', take, latched)
    node.create_subscription(TFMessage, '/tf', take, QoSProfile(depth=100))
