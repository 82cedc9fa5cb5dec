# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`bag_player` and `localizer` as processes over real DDS, against the replay of the same bag."""

from __future__ import annotations

import math
import os
import signal
import subprocess
import sys

from bag_samples import EPOCH, ODOM, serialized, small_drive, write_mcap
from drive_samples import recorded
from forked_nodes import fork
import numpy as np
import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from ros_support import GRAPH, Tester

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.io.messages import planar_pose, stamp_ns
from gip_localizer.io.tum_files import read_tum
from gip_localizer.parameters import load_parameter_file
from gip_localizer.ros.conversions import time_of
from gip_localizer.ros.middleware import image_environment
from gip_localizer.ros.processes import NodeProcesses

pytestmark = pytest.mark.ros

STREAM = serialized(small_drive())


@pytest.fixture
def tester():
    node = Tester()
    yield node
    node.close()


@pytest.fixture
def nodes(tmp_path):
    with NodeProcesses(tmp_path, {**GRAPH, **image_environment()}, fork) as processes:
        yield processes


def play(nodes, bag, listened, **parameters):
    """Start the player, which waits until all who listen are matched."""
    remappings = parameters.pop('remappings', ())
    waiting = {'bag': str(bag), 'wait_for': ','.join(listened)}
    return nodes.start('bag_player', {**waiting, **parameters}, remappings)


def prepared(tester, bag):
    """Publish the bag's calibration until the localizer has taken it in."""
    [info, *_] = [raw for topic, _, _, raw in recorded(bag) if topic == '/camera_info']

    def taken():
        tester.info.publish(info)
        return tester.said('calibration', 'OK')

    tester.until(tester.matched, 'the localizer')
    tester.until(taken, 'the calibration')


def test_the_bytes_of_the_bag_arrive_under_another_name(tester, nodes, tmp_path):
    bag = write_mcap(tmp_path / 'a.mcap', STREAM)
    heard = []
    tester.create_subscription(Odometry, '/wheels', heard.append, 100, raw=True)
    process = play(nodes, bag, ['/odom'], start=1.0, topics='/odom', rate=4.0,
                   remappings=['/odom:=/wheels'])  # fmt: skip
    tester.until(lambda: process.poll() is not None, 'the end of the bag')
    late = [raw for _, kind, log, raw in STREAM if kind == ODOM and log >= EPOCH + 10**9]
    tester.until(lambda: len(heard) == len(late), 'all odometry')
    assert heard == late


def test_a_loop_begins_again(tester, nodes, tmp_path):
    bag = write_mcap(tmp_path / 'a.mcap', STREAM)
    stamps = []
    tester.create_subscription(Odometry, '/odom', lambda m: stamps.append(stamp_ns(m.header)), 999)
    play(nodes, bag, ['/odom'], loop=True, rate=4.0)

    def second_round():
        """From where time goes back; a busy machine may lose some messages."""
        back = [n for n in range(1, len(stamps)) if stamps[n] < stamps[n - 1]]
        return stamps[back[0]:] if back else []

    tester.until(second_round, 'a second round')
    assert second_round()[0] == stamps[0]


READER = """
import rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
rclpy.init()
node = rclpy.create_node('reader')
node.create_subscription(Image, '/camera/image', lambda m: print(m.header.stamp, flush=True),
                         qos_profile_sensor_data)
rclpy.spin(node)
"""


def test_the_last_image_reaches_a_reader_that_was_held_up_at_the_end(tester, nodes, tmp_path):
    bag = write_mcap(tmp_path / 'a.mcap', STREAM)
    log, heard = tmp_path / 'bag_player.log', tmp_path / 'heard'
    late, last = ([str(time_of(EPOCH + i * 100_000_000)) for i in part]
                  for part in (range(13, 18), [19]))  # fmt: skip
    with heard.open('w') as out, subprocess.Popen(
        [sys.executable, '-c', READER], stdout=out, env={**os.environ, **GRAPH}
    ) as reader:
        try:
            play(nodes, bag, ['/camera/image'], rate=4.0)
            tester.until(lambda: any(stamp in heard.read_text() for stamp in late), 'images')
            # Fast DDS gives up a reader that is stopped for a second.
            reader.send_signal(signal.SIGSTOP)
            tester.until(lambda: 'end of the bag' in log.read_text(), 'the end of the bag')
            tester.spin(0.3)  # in which a player that does not wait has gone
            reader.send_signal(signal.SIGCONT)
            tester.until(lambda: last[0] in heard.read_text(), 'the last image')
        finally:
            reader.kill()


def test_node_and_replay_give_the_same_poses(tester, nodes, drive, whole):
    offline = read_tum(whole[0] / 'estimate.tum')
    settings = load_parameter_file(drive / 'params.yaml').replace(
        {'map_file': str(drive / 'map.yaml'), 'birdseye.resolution': 0.1}
    )
    nodes.start('localizer', settings.to_dict())
    prepared(tester, drive)
    process = play(nodes, drive, ['/image', '/odom', '/camera_info'], rate=0.25)
    tester.until(lambda: process.poll() is not None, 'the end of the bag')
    last = int(offline.stamps_ns[-1])
    tester.until(lambda: stamp_ns(tester.poses[-1].header) >= last, 'the last pose')
    live = {stamp_ns(m.header): planar_pose(m.pose) for m in tester.poses}
    common = [i for i, stamp in enumerate(offline.stamps_ns.tolist()) if stamp in live]
    assert len(common) >= 0.8 * len(offline)
    apart = np.array([
        difference(live[int(offline.stamps_ns[i])], Pose2(*offline.poses[i])) for i in common
    ])
    assert np.hypot(apart[:, 0], apart[:, 1]).max() < 1e-3
    assert np.abs(apart[:, 2]).max() < math.radians(0.01)
