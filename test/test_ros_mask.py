# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The mask topic over real DDS: a network that answers, lags, errs and falls silent."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip('rclpy')

from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import assert_near, camera_info, parameters, SECOND, START
from sensor_msgs.msg import Image

from gip_localizer.ros.conversions import bgr8, mono8

pytestmark = pytest.mark.ros
TENTH = SECOND // 10


class Network:
    """Sends images with a bonnet in them, and masks that hide it."""

    def __init__(self, tester, pixels):
        self.tester = tester
        self.masks = tester.create_publisher(Image, 'mask', 10)
        self.mask = np.full(pixels.shape, 255, np.uint8)
        self.mask[180:, 80:240] = 0
        stripes = np.where(np.arange(pixels.shape[1]) // 10 % 2, 240, 10)
        self.pixels = np.where(self.mask == 0, stripes, pixels).astype(np.uint8)
        self.stamp = 1_700_000_000 * SECOND

    def ready(self):
        return self.tester.matched() and self.masks.get_subscription_count()

    def frame(self, make=None, lag=2):
        """Send a frame and, after the images of some more turns, its mask."""
        self.stamp += TENTH
        self.tester.info.publish(camera_info())
        self.tester.image.publish(mono8(self.stamp, 'camera', self.pixels))
        self.spin(lag)
        if make is not None:
            self.masks.publish(make(self.stamp))
        self.spin(5)

    def good(self, stamp):
        return mono8(stamp, 'camera', self.mask)

    def spin(self, times):
        for _ in range(times):
            self.tester.executor_.spin_once(timeout_sec=0.02)

    def until(self, condition, what, make):
        def come():
            self.frame(make)
            return condition()

        self.tester.until(come, what)


def start(nodes, tester, map_file, render, **changes):
    settings = {'mask.from_topic': True, **{k.replace('__', '.'): v for k, v in changes.items()}}
    process = nodes.start('localizer', parameters(map_file, settings))
    network = Network(tester, render(START))
    tester.until(network.ready, 'the localizer to join', alive=process)
    return network


def test_images_are_localized_with_their_masks(nodes, tester, map_file, render):
    network = start(nodes, tester, map_file, render, mask__required=True)
    network.until(lambda: tester.poses, 'a pose', network.good)
    assert_near(tester.poses[-1], START)
    tester.until(lambda: tester.said('output', 'OK: TRACKING'), 'diagnostics')
    figures = {value.key: value.value for value in tester.status('camera').values}
    assert int(figures['masks']) > 0
    assert 'masks_refused' in figures


def test_bad_masks_are_named_and_poses_go_on(nodes, tester, map_file, render):
    network = start(nodes, tester, map_file, render)
    wrong = {
        "MASK_REFUSED: mask encoding 'bgr8'": lambda stamp: bgr8(
            stamp, 'camera', np.dstack([network.mask] * 3)),
        'MASK_REFUSED: mask is 160x120': lambda stamp: mono8(
            stamp, 'camera', network.mask[::2, ::2]),
        'ahead of the image': lambda stamp: network.good(stamp + 5 * SECOND),
        'MASK_MISSING': None,
    }
    for words, make in wrong.items():
        tester.poses.clear()
        network.until(lambda words=words: tester.said('camera', words) and tester.poses,
                      f'{words} and a pose', make)
    network.until(lambda: 'MASK' not in tester.status('camera').message, 'good masks',
                  network.good)
    assert_near(tester.poses[-1], START)


def test_where_masks_are_required_an_image_without_one_is_withheld(
    nodes, tester, map_file, render
):
    network = start(nodes, tester, map_file, render, mask__required=True)
    network.until(lambda: tester.said('output', 'WITHHELD: NO_MASK'), 'the silence', None)
    assert not tester.poses
    assert tester.set('mask.required', False).successful
    network.until(lambda: tester.poses, 'a pose', None)
