# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `synthetic_camera`: a rendered drive in real time, with odometry and ground truth."""

from __future__ import annotations

from collections.abc import Sequence
import os
import sys

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
import rclpy
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from gip_localizer.ros.conversions import (
    camera_info,
    jpeg,
    mono8,
    mono16,
    odometry_of,
    pose_stamped,
)
from gip_localizer.ros.endpoints import wait_for_delivery
from gip_localizer.ros.listener_wait import ANNOUNCEMENT, LISTENERS
from gip_localizer.ros.localizer.transforms import StaticCamera
from gip_localizer.ros.middleware import image_environment
from gip_localizer.ros.parameters import LiveParameters
from gip_localizer.ros.running import run_node
from gip_localizer.synthetic.drive import SyntheticDrive, SyntheticFrame
from gip_localizer.synthetic.parameters import CameraNodeParameters
from gip_localizer.synthetic.wheel_odometry import OdometryReading

EXAMPLE = '-p world.name:=tiles -p rate:=5.0 -p publish.wait:=true'
NS = 1_000_000_000
"""Nanoseconds per second."""
TICK = 0.002
"""Period (s) of the timer that publishes due messages; chosen."""
SET_OUT_NS = 200_000_000
"""Time (ns) between the start of the drive and its first frame; chosen."""
CAMERA_FRAME = 'camera'


class SyntheticCameraNode(Node):
    """
    Publishes a `SyntheticDrive`, each event at its time.

    Where rendering cannot keep up, the drive goes slower: stamps are moved on, none is skipped.

    Raises
    ------
    GipError
        A parameter, the world or the trajectory cannot be used.

    """

    def __init__(self) -> None:
        super().__init__('synthetic_camera')
        self._live = LiveParameters(self, CameraNodeParameters, self._retune)
        settings = self._live.value
        self._drive = SyntheticDrive(settings)
        self._drive.synthetic_camera  # noqa: B018 - built now, not at the first frame
        queue = QoSProfile(depth=10)
        if settings.publish.transport == 'compressed':
            self._image = self.create_publisher(CompressedImage, 'image/compressed', queue)
        else:
            self._image = self.create_publisher(Image, 'image', queue)
        self._info = self.create_publisher(CameraInfo, 'camera_info', queue)
        self._odom = self.create_publisher(Odometry, 'odom', QoSProfile(depth=100))
        self._truth = self.create_publisher(PoseStamped, 'ground_truth', QoSProfile(depth=100))
        self._mount = StaticCamera(self, settings.frames.base, CAMERA_FRAME)
        self._mount.place(settings.camera)
        self._set_out = False
        self._behind_ns = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(TICK, self._play, clock=steady)
        self.create_timer(ANNOUNCEMENT, self._announce, clock=steady)
        self.get_logger().info(
            f'{settings.lens.width} x {settings.lens.height} pixels at {settings.rate:g} Hz over '
            f'{settings.world.name}' + ('; waiting for listeners' if settings.publish.wait else '')
        )

    def _retune(self, settings: CameraNodeParameters) -> None:
        held = self._drive.parameters.camera
        self._drive.parameters = settings
        camera = self._drive.synthetic_camera
        camera.parameters = settings
        if settings.camera != held:
            # The camera has another pose: the next one is built with the next frame.
            self._mount.place(settings.camera)
            del self._drive.synthetic_camera

    def _ready(self) -> bool:
        """Start the drive when it is time; return whether it has begun."""
        if self._set_out:
            return True
        waits = self._live.value.publish.wait
        publishers = (self._image, self._info, self._odom)
        if waits and not all(publisher.get_subscription_count() for publisher in publishers):
            return False
        now = self._now_ns()
        self._drive.start_ns = now + (round(LISTENERS * NS) if waits else SET_OUT_NS)
        self._events = self._drive.events()
        self._next = next(self._events, None)
        self._set_out = True
        self._announce()
        return True

    def _announce(self) -> None:
        """Publish the calibration before the first frame."""
        now = self._now_ns()
        if self._set_out and now < self._drive.start_ns:
            calibration = self._drive.synthetic_camera.calibration
            self._info.publish(camera_info(now, CAMERA_FRAME, calibration))

    def _play(self) -> None:
        """Publish the due messages."""
        if not self._ready():
            return
        while self._next is not None and self._due(self._next) <= self._now_ns():
            if isinstance(self._next, SyntheticFrame):
                self._send_frame(self._next)
            else:
                self._send_odometry(self._next)
            self._next = next(self._events, None)
        if self._next is None:
            self._end()

    def _due(self, event: SyntheticFrame | OdometryReading) -> int:
        if isinstance(event, SyntheticFrame):
            return event.stamp_ns + self._behind_ns
        return event.sample.stamp_ns + self._behind_ns

    def _send_frame(self, frame: SyntheticFrame) -> None:
        late_ns = self._now_ns() - self._due(frame)
        if late_ns > NS / self._live.value.rate:
            self._behind_ns += late_ns
            self.get_logger().warning(
                'rendering takes longer than a frame may: the drive goes slower; '
                'lower rate, lens.width and lens.height help', throttle_duration_sec=5.0,
            )  # fmt: skip
        stamp = self._due(frame)
        frames = self._live.value.frames
        self._truth.publish(pose_stamped(stamp, frames.map, frame.truth))
        self._info.publish(camera_info(stamp, CAMERA_FRAME, frame.calibration))
        self._image.publish(self._message(stamp, frame))

    def _message(self, stamp: int, frame: SyntheticFrame) -> Image | CompressedImage:
        publish = self._live.value.publish
        if publish.transport == 'compressed':
            return jpeg(stamp, CAMERA_FRAME, frame.image, publish.jpeg_quality)
        pack = mono8 if frame.image.dtype.itemsize == 1 else mono16
        return pack(stamp, CAMERA_FRAME, frame.image)

    def _send_odometry(self, reading: OdometryReading) -> None:
        frames = self._live.value.frames
        self._odom.publish(odometry_of(self._due(reading), frames.odom, frames.base, reading))

    def _end(self) -> None:
        self.get_logger().info('end of the drive')
        wait_for_delivery((self._image, self._info, self._odom, self._truth))
        rclpy.try_shutdown()

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit code is 0 after the end of the drive or an orderly stop."""
    # Fast DDS reads this when the node joins the graph: large images need it.
    os.environ.update(image_environment())
    return run_node(SyntheticCameraNode, 'synthetic_camera', args, example=EXAMPLE)


if __name__ == '__main__':
    sys.exit(main())
