# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
A soak over DDS: everything that can go wrong on a vehicle does, at random, again and again.

`make soak MINUTES=30` runs for half an hour and prints a summary (the suite: 12 s).

"""

from __future__ import annotations

from collections import Counter
import math
import os
import re
import time

import numpy as np
import psutil
import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import CALIBRATION, camera_info, initial_pose, parameters, SECOND, START
from ros_support import GRAPH
from sensor_msgs.msg import Image

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.io.messages import planar_pose
from gip_localizer.ros.conversions import header_of, mono8, pose_of
from gip_localizer.ros.processes import NodeProcesses
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS

pytestmark = pytest.mark.ros
LENGTH = float(os.environ.get('GIP_SOAK', '12'))
RATE = 30.0
RULE = re.compile(r'(?:^|; )([A-Z_]{2,})(?=:|;|$)')
"""The names with which diagnostics begin what they say."""
GROWTH = 1.05
"""Of the median of the node's own memory: preparing for a camera takes more for a while."""
SETTINGS = {
    'search.x': (0.2, 0.9), 'search.y': (0.2, 0.9), 'search.yaw': (0.01, 0.1),
    'score.map_noise': (0.01, 0.05), 'birdseye.half_width': (1.0, 1.6), 'birdseye.far': (5.0, 6.5),
    'integrity.lost_after': (2, 9),
}  # fmt: skip


class Trouble:
    """What the vehicle suffers, from a seed."""

    def __init__(self, tester, render):
        self.tester = tester
        self.masks = tester.create_publisher(Image, 'mask', 10)
        self.mask = np.full((CALIBRATION.height, CALIBRATION.width), 255, np.uint8)
        self.rng = np.random.default_rng(7)
        self.pixels = render(START)
        self.stamp = 1_700_000_000 * SECOND
        self.heard = self.frames = 0
        self.worst = [0.0, 0.0]
        self.happened, self.reported = Counter(), Counter()

    def second(self):
        """One second of frames, with one trouble of a kind."""
        kind = str(self.rng.choice(['none', 'silence', 'calibration', 'resolution', 'jump',
                                    'rewind', 'parameters', 'prior', 'dark', 'frozen odometry',
                                    'odometry off time', 'no mask', 'bad mask']))
        self.happened[kind] += 1
        if kind == 'parameters':
            self._set_something()
        if kind == 'rewind':
            self.stamp -= 100 * SECOND
        for n in range(round(RATE)):
            self.stamp += round(SECOND / RATE)
            started = time.monotonic()
            self._send(kind, n)
            while time.monotonic() - started < 1.0 / RATE:
                self.tester.executor_.spin_once(timeout_sec=0.002)
        if kind == 'rewind':
            self.tester.initial.publish(initial_pose(START))

    def _set_something(self):
        name = str(self.rng.choice(list(SETTINGS)))
        low, high = SETTINGS[name]
        value = self.rng.uniform(low, high)
        result = self.tester.set(name, int(value) if isinstance(low, int) else float(value))
        assert result.successful, result.reason

    def _send(self, kind, n):
        self._send_odometry(kind, n)
        if kind == 'silence':
            return
        info = camera_info()
        if kind == 'calibration' and n % 2:
            info = camera_info(k=CALIBRATION.K.ravel() * self.rng.uniform(0.0, 3.0))
        self.tester.info.publish(info)
        pixels = self.pixels
        if kind == 'resolution' and n % 3:
            pixels = pixels[:: n % 3 + 1, :: n % 3 + 1].copy()
        elif kind == 'dark':
            pixels = (pixels // 200).astype(np.uint8)
        self.tester.image.publish(mono8(self.stamp, 'camera', pixels))
        self.frames += 1
        if kind != 'no mask':
            step = 2 if kind == 'bad mask' and n % 2 else 1
            self.masks.publish(mono8(self.stamp, 'camera', self.mask[::step, ::step]))
        if kind == 'prior' and n == 5:
            self.tester.initial.publish(initial_pose(Pose2(math.nan, 0.0, 0.0)))

    def _send_odometry(self, kind, n):
        base = START if kind != 'jump' or n % 10 else Pose2(500.0, 0.0, 0.0)
        if kind == 'frozen odometry':
            base = Pose2(0.0, 0.0, 0.0)
        stamp = self.stamp + (5_702_400 * SECOND if kind == 'odometry off time' else 0)
        odometry = Odometry(header=header_of(stamp, 'odom'), child_frame_id='base_link')
        odometry.pose.pose = pose_of(base)
        self.tester.odom.publish(odometry)

    def judge(self):
        """Every pose that came is right, and diagnostics came with all concerns."""
        for pose in self.tester.poses:
            apart = difference(planar_pose(pose.pose), START)
            errors = math.hypot(apart[0], apart[1]), abs(apart[2])
            self.worst = [max(pair) for pair in zip(self.worst, errors, strict=True)]
            assert errors[0] < 0.5
            assert errors[1] < math.radians(2.0)
        for message in self.tester.diagnostics:
            self.reported.update({word for status in message.status
                              for word in RULE.findall(status.message)})
        self.heard += len(self.tester.poses)
        self.tester.poses.clear()
        self.tester.with_covariance.clear()
        assert self.tester.diagnostics
        assert len(self.tester.diagnostics[-1].status) == len(DIAGNOSTIC_GROUPS)
        del self.tester.diagnostics[:-1]

    def summary(self, sizes):
        """Return what a person wants to know after half an hour."""
        def listed(counts):
            return ', '.join(f'{name} {times}' for name, times in sorted(counts.items()))

        return '\n'.join([
            f'frames sent            {self.frames}',
            f'poses published        {self.heard}, all right: the worst is '
            f'{1e3 * self.worst[0]:.1f} mm and {math.degrees(self.worst[1]):.3f} deg off',
            f'own memory             {sizes[0] / 2**20:.1f} MiB after the first second, '
            f'{max(sizes) / 2**20:.1f} at most, {sizes[-1] / 2**20:.1f} at the end',
            f'... by thirds          {", ".join(f"{m / 2**20:.1f}" for m in medians(sizes))} MiB '
            '(medians)',
            f'seconds of each kind   {listed(self.happened)}',
            f'in the diagnostics     {listed(self.reported)}',
        ])


def medians(sizes):
    return [float(np.median(part)) for part in np.array_split(sizes, 3)]


@pytest.fixture
def nodes_in_interpreters(tmp_path):
    """As in a vehicle: a fork would share memory with others."""
    with NodeProcesses(tmp_path, GRAPH) as processes:
        yield processes


def test_a_soak_leaves_the_node_alive_right_and_of_the_same_size(
    nodes_in_interpreters, tester, map_file, render
):
    # A lost pose is found by initialpose here: the search of the map costs what it costs.
    process = nodes_in_interpreters.start('localizer', parameters(map_file, {
        'recovery.automatic': False, 'mask.from_topic': True,
    }))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    trouble, memory = Trouble(tester, render), psutil.Process(process.pid)
    tester.until(trouble.masks.get_subscription_count, 'the localizer to take masks')
    sizes = []
    begin = time.monotonic()
    while time.monotonic() - begin < LENGTH:
        trouble.second()
        assert process.poll() is None
        trouble.judge()
        sizes.append(memory.memory_full_info().uss)
        tester.initial.publish(initial_pose(START))
    print(f'\nsoaked for {time.monotonic() - begin:.0f} s\n{trouble.summary(sizes)}')  # noqa: T201
    assert trouble.heard > LENGTH
    if LENGTH >= 120.0:  # a short one does not reach all that is allocated once
        _, middle, last = medians(sizes)
        assert last < GROWTH * middle
