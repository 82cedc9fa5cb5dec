# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip doctor --topics` in a running stack, right and wrong."""

from __future__ import annotations

from array import array
import re
import subprocess
import sys
import time

import pytest

pytest.importorskip('rclpy')

from forked_nodes import fork
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import camera_info, localized, parameters, START
from ros_support import GRAPH, PATIENCE, Tester
from sensor_msgs.msg import CameraInfo, Image

from gip_localizer.parameters import Parameters
from gip_localizer.parameters.localizer import dump_parameter_file
from gip_localizer.ros.conversions import mono8, pose_of
from gip_localizer.ros.doctor.check import summary_line
from gip_localizer.ros.doctor.observed import Heard, Observed
from gip_localizer.ros.doctor.stack import stack_checks
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros
S = 1_000_000_000
NOW = 1_800_000_000 * S


@pytest.fixture(scope='module')
def stack(tmp_path_factory, map_file, render):
    """A localizer that tracks, its tester, and a camera that goes on while something waits."""
    tester = Tester()
    with NodeProcesses(tmp_path_factory.mktemp('stack'), GRAPH, fork) as nodes:
        process = nodes.start('localizer', parameters(map_file))
        tester.until(tester.matched, 'the localizer to join', alive=process)
        stack = Stack(tester, render(START))
        localized(tester, stack.images(), process)
        yield stack
    tester.close()


class Stack:
    """Publishes as a camera does, stamped by the system's clock."""

    def __init__(self, tester, pixels):
        self.tester, self.pixels = tester, pixels
        self.frame = 'camera'

    def images(self):
        while True:
            yield self.image()

    def image(self):
        noisy = self.pixels.copy()
        noisy[0, 0] = time.time_ns() // 100_000_000 % 256
        return mono8(time.time_ns(), self.frame, noisy)

    def drive(self):
        """Publish one image, its calibration and odometry."""
        info = camera_info()
        info.header.frame_id = 'camera'
        self.tester.info.publish(info)
        image = self.image()
        odometry = Odometry(header=image.header, child_frame_id='base_link')
        self.tester.image.publish(image)
        odometry.header.frame_id = 'odom'
        odometry.pose.pose = pose_of(START)
        self.tester.odom.publish(odometry)

    def doctor(self, *options, drive=None):
        """Run `gip doctor --topics` while the camera goes on at 10 Hz."""
        process = subprocess.Popen(
            [sys.executable, '-m', 'gip_localizer.cli', 'doctor', '--topics', '--seconds', '2',
             *options], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )  # fmt: skip
        until = time.monotonic() + PATIENCE
        while process.poll() is None:
            assert time.monotonic() < until
            (drive or self.drive)()
            self.tester.spin(0.1)
        said = process.stdout.read()
        failed = [name.strip() for name in re.findall(r'^FAIL  (.{14})', said, re.MULTILINE)]
        return process.returncode, failed, said


def test_a_stack_that_works_passes(stack):
    code, failed, said = stack.doctor()
    assert (code, failed) == (0, []), said
    assert re.search(r'image +/image: \d+\.\d Hz, 320 x 240', said)
    assert 'odom           /odom: ' in said
    assert re.search(r'poses +/pose: \d+ poses of \d+ images', said)


def test_a_wrong_topic_is_named_with_the_one_that_is_there(stack):
    code, failed, said = stack.doctor('--image-topic', '/front/image_raw')
    assert code == 1
    assert 'image' in failed
    assert 'nothing publishes /front/image_raw; of its type there is /image' in said
    assert 'remedy: remap: -r image:=/image' in said


def test_before_the_start_a_parameter_file_is_judged_with_the_topics(stack, map_file, tmp_path):
    far = parameters(map_file, {'initial_pose.x': 500.0, 'image_reliability': 'reliable'})
    path = tmp_path / 'far.yaml'
    path.write_text(dump_parameter_file(Parameters.from_dict(far)))
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    other = stack.tester.create_publisher(Image, 'rear/image', best_effort)
    code, failed, said = stack.doctor('--node', 'nobody', '--params', str(path),
                                      '--image-topic', 'rear/image')
    stack.tester.destroy_publisher(other)
    assert code == 1
    assert failed == ['node', 'image', 'map']
    assert '0 % of the view at initial_pose is known' in said
    assert 'offered best_effort, volatile, requested reliable, volatile' in said


def seen(**changes):
    """A stack without fault, as the doctor hears it, with changes."""
    stamps = [NOW + k * S // 10 for k in range(20)]
    pixels = Image(width=320, height=240, encoding='mono8', step=320)
    pixels.data = array('B', bytes(320 * 240))
    info, odometry = camera_info(), Odometry(child_frame_id='base_link')
    odometry.header.frame_id = 'odom'
    topics = {
        'image': Heard('/image', 1, '', [], list(stamps), list(stamps), {'camera'}, pixels),
        'camera_info': Heard('/camera_info', 1, '', [], list(stamps), list(stamps), {'camera'},
                             info),
        'odom': Heard('/odom', 1, '', [], list(stamps), list(stamps), {'odom'}, odometry),
        'pose': Heard('/pose', 1, '', [], list(stamps), list(stamps), {'map'}, None),
    }
    # The view of the scene: its camera looks down at 0.35 rad.
    tuned = Parameters.from_dict({'camera.z': 1.2, 'camera.pitch': 0.35})
    stack = Observed(2.0, '/localizer', '', tuned, False, topics,
                     statuses={'map': (0, 'OK'), 'output': (0, 'OK')})
    for name, value in changes.items():
        role, _, attribute = name.partition('__')
        if attribute:
            setattr(topics[role], attribute, value)
        else:
            setattr(stack, name, value)
    return stack


def test_a_stack_without_fault_passes():
    checks = list(stack_checks(seen()))
    assert summary_line(checks) == 'all 9 checks passed', [check.lines() for check in checks]


GAPS = [NOW + k * S // 10 for k in range(40) if k % 10 not in (3, 4)]


@pytest.mark.parametrize(('changes', 'name', 'words'), [
    ({'node': ''}, 'node', 'no localizer runs'),
    ({'state': 'inactive'}, 'node', 'ros2 lifecycle set /localizer activate'),
    ({'sim_time': True}, 'clock', '/clock does not move'),
    ({'image__arrivals_ns': [NOW + 5 * S] * 20}, 'clock', 'synchronize the clocks'),
    ({'image__arrivals_ns': [NOW + 5 * S] * 20, 'clocks_ns': [NOW]}, 'clock',
     'use_sim_time: true'),
    ({'image__publishers': 0}, 'image', 'nothing publishes /image'),
    ({'image__last': None, 'image__stamps_ns': []}, 'image', 'no message in 2 s'),
    ({'image__stamps_ns': [0] * 20}, 'image', 'header.stamp is 0'),
    ({'image__stamps_ns': [NOW] * 20}, 'image', 'stamps repeat'),
    ({'image__stamps_ns': GAPS, 'image__arrivals_ns': GAPS}, 'image', '% of the frames are lost'),
    ({'image__last': Image(width=3, height=3, encoding='magic')}, 'image', 'magic'),
    ({'camera_info__last': CameraInfo(width=640, height=480)}, 'camera_info', 'not calibrated'),
    ({'camera_info__last': camera_info(width=1000, height=900)}, 'camera_info', '1000'),
    ({'camera_info__last': camera_info(distortion_model='')}, 'camera_info',
     'used as plumb_bob'),
    ({'parameters': Parameters.from_dict({'camera.pitch': -0.6})}, 'camera_info', 'no road'),
    ({'odom__last': Odometry(child_frame_id='trailer')}, 'odom', "of frame 'trailer'"),
    ({'odom__stamps_ns': [NOW + 60 * S] * 20}, 'odom', 'from those of the images'),
    ({'camera_info__frames': {'rear'}}, 'frames', 'images and camera_info differ'),
    ({'parameters': Parameters.from_dict({'camera.z': 1.2, 'camera.pitch': 0.35,
                                          'camera.from_tf': True})}, 'tf', 'tf2_msgs'),
    ({'statuses': {'map': (2, 'OFF_MAP')}}, 'map', 'OFF_MAP'),
    ({'statuses': {}}, 'map', 'map_file is empty'),
    ({'pose__stamps_ns': [], 'statuses': {'prior': (1, 'NO_PRIOR')}}, 'poses', 'NO_PRIOR'),
])
def test_each_fault_fails_its_check_with_a_remedy(changes, name, words):
    failed = {check.name: check for check in stack_checks(seen(**changes)) if not check.passed}
    assert name in failed
    assert words in failed[name].lines()
    assert failed[name].remedy
