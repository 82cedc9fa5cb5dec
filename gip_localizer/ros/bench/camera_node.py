# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A camera for the benchmark, with images made beforehand, so that rendering takes no time."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
import os
from pathlib import Path
import sys

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile
from sensor_msgs.msg import CameraInfo, Image

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.pose import Pose2
from gip_localizer.ros.conversions import bgr8, camera_info, mono8, pose_of, pose_stamped, time_of
from gip_localizer.ros.middleware import image_environment
from gip_localizer.ros.running import run_node

NAME = 'bench_camera'
LISTENERS = 2
"""Number of subscribers to wait for: localizer and echo."""


class BenchCamera(Node):
    """Publishes the images, odometry and truth of a folder in a loop, stamped with the clock."""

    def __init__(self) -> None:
        super().__init__(NAME)
        folder = Path(str(self.declare_parameter('folder', '').value))
        rate = float(self.declare_parameter('rate', 30.0).value)
        pack = {'mono8': mono8, 'bgr8': bgr8}[str(self.declare_parameter('encoding', 'x').value)]
        stored = np.load(folder / 'drive.npz')
        height, width = stored['images'].shape[1:3]
        self._info_message = camera_info(0, 'camera', Calibration(width, height, stored['K']))
        messages = [pack(0, 'camera', image) for image in stored['images']]
        poses = [Pose2(*(float(k) for k in pose)) for pose in stored['poses']]
        there = list(zip(messages, poses, strict=True))
        self._drive = cycle([*there, *there[-2:0:-1]])
        queue = QoSProfile(depth=10)
        self._image = self.create_publisher(Image, 'image', queue)
        self._info = self.create_publisher(CameraInfo, 'camera_info', queue)
        self._odom = self.create_publisher(Odometry, 'odom', QoSProfile(depth=100))
        self._truth = self.create_publisher(PoseStamped, 'ground_truth', QoSProfile(depth=100))
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0 / rate, self._send, clock=clock)

    def _send(self) -> None:
        stamp = int(self.get_clock().now().nanoseconds)
        self._info_message.header.stamp = time_of(stamp)
        self._info.publish(self._info_message)
        if self._image.get_subscription_count() < LISTENERS:
            return
        image, pose = next(self._drive)
        odometry = Odometry(child_frame_id='base_link')
        odometry.header.stamp, odometry.header.frame_id = time_of(stamp), 'odom'
        odometry.pose.pose = pose_of(pose)
        self._odom.publish(odometry)
        self._truth.publish(pose_stamped(stamp, 'map', pose))
        # The stamp is taken as late as possible: the measurement starts here.
        image.header.stamp = time_of(stamp)
        self._image.publish(image)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node."""
    os.environ.update(image_environment())
    return run_node(BenchCamera, NAME, args)


if __name__ == '__main__':
    sys.exit(main())
