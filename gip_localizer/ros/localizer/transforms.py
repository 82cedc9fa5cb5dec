# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
/tf and /tf_static, where their message is installed; the only module that knows of tf2.

No more than the message is needed: what is static is looked up by `io.static_transforms`, and
map to odom follows from a pose and the odometry at its stamp.

"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from gip_localizer.core.camera.model import Extrinsics
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import ParameterError
from gip_localizer.io.static_transforms import StaticTransforms, TransformError
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


class CameraFromTf:
    """
    Follows /tf_static, and tells when the camera's pose in the vehicle becomes known or changes.

    Parameters
    ----------
    node : Node
        Listens.
    base : str
        Frame of the vehicle.
    found : callable
        Told the extrinsics; raises ParameterError where no camera can be.
    fault : callable
        Told what is wrong; None when nothing is.

    """

    def __init__(
        self, node: Node, base: str, found: Callable[[Extrinsics], None],
        fault: Callable[[str | None], None],
    ) -> None:
        require_transforms('camera.from_tf')
        self._base, self._found, self._fault = base, found, fault
        self._tree = StaticTransforms()
        self._optical: str | None = None
        self._known: Extrinsics | None = None
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(TFMessage, '/tf_static', self._take, latched)
        self._fault('no image or camera_info has named its frame yet')

    @property
    def known(self) -> bool:
        """Whether the camera's pose is known."""
        return self._known is not None

    def seen_in(self, frame: str) -> None:
        """Take the frame that an image or a camera_info names."""
        if frame != self._optical:
            self._optical = frame
            self._known = None
            self._look_up()

    def _take(self, message: Any) -> None:
        try:
            self._tree.take(message.transforms)
        except TransformError as error:
            self._fault(f'/tf_static: {error}')
            return
        self._look_up()

    def _look_up(self) -> None:
        if self._optical is None:
            return
        try:
            extrinsics = self._tree.extrinsics(self._base, self._optical)
        except TransformError as error:
            if self._known is None:
                self._fault(str(error))
            return
        if extrinsics != self._known:
            self._known = None
            try:
                self._found(extrinsics)
            except ParameterError as error:
                self._fault(f'{self._base!r} to {self._optical!r}: {error}')
                return
            self._known = extrinsics
        self._fault(None)
