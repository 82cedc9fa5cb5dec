# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Input that cannot be right, over real DDS: named in `/diagnostics`, poses go on being right."""

from __future__ import annotations

import math

from nav_msgs.msg import Odometry
import numpy as np
import pytest

pytest.importorskip('rclpy')

from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import assert_near, camera_info, initial_pose, SECOND, START

from gip_localizer.core.pose import Pose2
from gip_localizer.ros.conversions import header_of, mono8, pose_of

pytestmark = pytest.mark.ros
TENTH = SECOND // 10
DAYS_66 = 66 * 86_400 * SECOND
STILL = Pose2(0.0, 0.0, 0.0)


class Vehicle:
    """Drives a quarter of a metre a frame and back again; every picture has noise of its own."""

    def __init__(self, tester, process, render):
        self.tester, self.process = tester, process
        self.stamp = 1_700_000_000 * SECOND
        self.places = [START @ Pose2(0.25 * n, 0.0, 0.0) for n in (0, 1, 2, 3, 4, 3, 2, 1)]
        self.views = [render(place).astype(float) for place in self.places]
        self.rng = np.random.default_rng(3)
        self.turn = 0

    def frame(self, odometry=()):
        """Send messages of odometry, then a frame; odometry is true where none is given."""
        self.stamp += TENTH
        place = self.turn % len(self.places)
        for offset_ns, pose, frames in odometry or [(0, self.places[place], {})]:
            self.odometry(self.stamp + offset_ns, pose, **frames)
        noisy = self.views[place] + self.rng.normal(0.0, 2.0, self.views[place].shape)
        self.send(np.clip(noisy, 0, 255).astype(np.uint8), self.stamp)
        self.turn += 1

    def send(self, pixels, stamp):
        self.tester.info.publish(camera_info())
        self.tester.image.publish(mono8(stamp, 'camera', pixels))
        for _ in range(5):
            self.tester.executor_.spin_once(timeout_sec=0.02)
        assert self.process.poll() is None

    def odometry(self, stamp, pose, frame='odom', child='base_link'):
        message = Odometry(header=header_of(stamp, frame), child_frame_id=child)
        message.pose.pose = pose_of(pose)
        self.tester.odom.publish(message)

    def until_said(self, concern, word, **how):
        """Drive until the diagnostics say a word and a pose came meanwhile."""
        self.tester.poses.clear()

        def said():
            self.frame(**how)
            return self.tester.said(concern, word) and self.tester.poses

        self.tester.until(said, f'{word} and a pose', alive=self.process)
        self.judge()

    def judge(self):
        """Compare every received pose with the true pose at its stamp."""
        for message in self.tester.poses:
            age = (self.stamp - message.header.stamp.sec * SECOND - message.header.stamp.nanosec)
            turn = self.turn - 1 - round(age / TENTH)
            assert_near(message, self.places[turn % len(self.places)])


@pytest.fixture
def vehicle(tester, localizer, render):
    vehicle = Vehicle(tester, localizer, render)

    def came():
        vehicle.frame()
        return len(tester.poses) > 2

    tester.until(came, 'poses', alive=localizer)
    return vehicle


@pytest.mark.parametrize(('word', 'messages'), [
    ('ODOMETRY_CONTRADICTED', [(0, STILL, {})]),
    ('66.0 days ahead of the image', [(DAYS_66, STILL, {})]),
    ('66.0 days behind the image', [(-DAYS_66, STILL, {})]),
    ("in frame 'map'", [(0, STILL, {'frame': 'map'})]),
    ("of frame 'trailer'", [(0, STILL, {'child': 'trailer'})]),
    ('odometry jumped', [(-TENTH // 2, STILL, {}), (0, Pose2(10.0, 0.0, 0.0), {})]),
    ('holds NaN', [(0, Pose2(math.nan, 0.0, 0.0), {})]),
    ('repeats the stamp', [(0, STILL, {}), (0, STILL, {})]),
])  # fmt: skip
def test_bad_odometry_is_named_and_poses_stay_right(vehicle, word, messages):
    vehicle.until_said('odometry', word, odometry=messages)


@pytest.mark.parametrize('variance', [-0.04, math.nan])
def test_an_initialpose_with_a_bad_covariance_is_named_and_changes_nothing(
    vehicle, tester, variance
):
    message = initial_pose(START @ Pose2(5.0, 0.0, 0.0))
    message.pose.covariance = np.diag([variance, variance, 0.0, 0.0, 0.0, 0.001]).ravel()
    tester.initial.publish(message)
    vehicle.until_said('prior', 'INITIALPOSE_REFUSED')


def test_frames_that_repeat_or_come_late_are_named(vehicle, tester):
    pixels = vehicle.views[0].astype(np.uint8)

    def late():
        vehicle.frame()
        vehicle.send(pixels, vehicle.stamp - TENTH // 2)
        return tester.said('camera', 'OUT_OF_ORDER')

    tester.until(late, 'OUT_OF_ORDER')

    def the_same_pixels():
        vehicle.stamp += TENTH
        vehicle.odometry(vehicle.stamp, Pose2(0.2 * vehicle.stamp / SECOND % 100.0, 0.0, 0.0))
        vehicle.send(pixels, vehicle.stamp)
        return tester.said('camera', 'FROZEN_IMAGE')

    tester.until(the_same_pixels, 'FROZEN_IMAGE')
    tester.poses.clear()
    the_same_pixels()
    assert not tester.poses
