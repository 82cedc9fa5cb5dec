# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A small world, its camera and a localizer process, for tests over real DDS."""

from __future__ import annotations

from array import array
from itertools import count
import math

import cv2
from forked_nodes import fork
from geometry_msgs.msg import PoseWithCovarianceStamped
import numpy as np
import pytest
from ros_support import GRAPH, Tester
from sensor_msgs.msg import CameraInfo

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.io.map_files import save_map
from gip_localizer.io.messages import planar_pose
from gip_localizer.ros.conversions import header_of, mono8, pose_of
from gip_localizer.ros.processes import NodeProcesses
from gip_localizer.synthetic.renderer import Renderer

START = Pose2(1.0, -0.5, 0.3)
EXTRINSICS = Extrinsics(x=0.2, y=-0.1, z=1.2, roll=0.01, pitch=0.35, yaw=-0.02)
INTRINSICS = np.array([[300.0, 0.0, 159.5], [0.0, 300.0, 119.5], [0.0, 0.0, 1.0]])
CALIBRATION = Calibration(320, 240, INTRINSICS, np.array([-0.05, 0.01, 0.0, 0.0, 0.0]))
VIEW = {
    'birdseye.near': 1.8, 'birdseye.far': 6.0, 'birdseye.half_width': 1.5,
    'birdseye.resolution': 0.05,
}
SECOND = 1_000_000_000


def blurred_noise(seed):
    """A road like no other at any place: noise with features of some cells."""
    noise = np.random.default_rng(seed).normal(size=(500, 500)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0) + cv2.GaussianBlur(noise, (0, 0), 8.0) * 3.0
    return np.clip(0.45 + 0.15 * smooth / smooth.std(), 0.0, 1.0).astype(np.float32)


WORLD = RasterMap(blurred_noise(4), 0.04, Pose2(-10.0, -10.0, 0.0))


@pytest.fixture(scope='module')
def map_file(tmp_path_factory):
    path = tmp_path_factory.mktemp('map') / 'road.yaml'
    save_map(WORLD, path)
    return path


@pytest.fixture(scope='module')
def render():
    renderer = Renderer(WORLD, CameraModel(CALIBRATION, EXTRINSICS))
    return lambda pose: np.round(255.0 * renderer.render(pose)).astype(np.uint8)


@pytest.fixture
def tester():
    node = Tester()
    yield node
    node.close()


@pytest.fixture
def nodes(tmp_path):
    with NodeProcesses(tmp_path, GRAPH, fork) as processes:
        yield processes


def parameters(map_file, changes=None):
    camera = {f'camera.{name}': float(value) for name, value in vars(EXTRINSICS).items()}
    start = {f'initial_pose.{name}': float(getattr(START, name)) for name in ('x', 'y', 'yaw')}
    fixed = {'map_file': str(map_file), 'initial_pose.set': True}
    return {**fixed, **camera, **start, **VIEW, **(changes or {})}


@pytest.fixture
def localizer(nodes, tester, map_file):
    process = nodes.start('localizer', parameters(map_file))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    return process


def camera_info(**changes):
    info = CameraInfo(width=320, height=240, distortion_model='plumb_bob')
    info.k, info.d = INTRINSICS.ravel(), array('d', CALIBRATION.D)
    info.p = np.hstack([INTRINSICS, np.zeros((3, 1))]).ravel()
    info.r = np.eye(3).ravel()
    for name, value in changes.items():
        setattr(info, name, value)
    return info


def initial_pose(pose, frame='map'):
    message = PoseWithCovarianceStamped(header=header_of(SECOND, frame))
    message.pose.pose = pose_of(pose)
    message.pose.covariance = np.diag([0.04, 0.04, 0.0, 0.0, 0.0, 0.001]).ravel()
    return message


def send(tester, image, process, info=None):
    """Send one frame, and listen for a moment."""
    tester.info.publish(info or camera_info())
    tester.image.publish(image)
    for _ in range(5):
        tester.executor_.spin_once(timeout_sec=0.02)
    assert process.poll() is None


def frames(pixels, start_ns=1_700_000_000 * SECOND):
    """Yield the same picture again and again, a tenth of a second apart."""
    for stamp in count(start_ns, SECOND // 10):
        yield mono8(stamp, 'camera', pixels)


def localized(tester, images, process):
    """Send frames until a pose comes (the first ones may precede the calibration)."""
    wanted = len(tester.poses) + 1

    def came():
        send(tester, next(images), process)
        return len(tester.poses) >= wanted

    tester.until(came, 'a pose', alive=process)
    return tester.poses[-1]


def assert_near(message, truth):
    """Within half a centimetre and a tenth of a degree: an eighth of a map cell."""
    apart = difference(planar_pose(message.pose), truth)
    assert math.hypot(apart[0], apart[1]) < 0.005
    assert abs(apart[2]) < math.radians(0.1)
