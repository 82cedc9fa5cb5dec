# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Two nodes in two namespaces, one per camera, side by side on one graph."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from forked_nodes import fork
from geometry_msgs.msg import PoseStamped
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import assert_near, camera_info, frames, parameters, START
from sensor_msgs.msg import CameraInfo, Image

from gip_localizer.core.pose import Pose2
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros
PLACES = {'front': START, 'rear': Pose2(-4.0, 3.0, 2.0)}


def test_each_localizes_its_own_camera(tester, map_file, render, tmp_path):
    heard = {name: [] for name in PLACES}
    with NodeProcesses(tmp_path, {}, fork) as first, NodeProcesses(tmp_path, {}, fork) as second:
        for (name, place), nodes in zip(PLACES.items(), (first, second), strict=True):
            start = {f'initial_pose.{axis}': float(getattr(place, axis))
                     for axis in ('x', 'y', 'yaw')}
            nodes.start('localizer', parameters(map_file, start), [f'__ns:=/{name}'])
            tester.create_subscription(PoseStamped, f'/{name}/pose', heard[name].append, 10)
        cameras = {
            name: (tester.create_publisher(Image, f'/{name}/image', 10),
                   tester.create_publisher(CameraInfo, f'/{name}/camera_info', 10),
                   frames(render(place)))
            for name, place in PLACES.items()
        }

        def both():
            for image, info, pictures in cameras.values():
                info.publish(camera_info())
                image.publish(next(pictures))
            for _ in range(5):
                tester.executor_.spin_once(timeout_sec=0.02)
            return all(len(poses) > 3 for poses in heard.values())

        tester.until(both, 'poses of both')
    for name, place in PLACES.items():
        for pose in heard[name]:
            assert_near(pose, place)
