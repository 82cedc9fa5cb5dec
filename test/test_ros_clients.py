# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What real clients send, and how: unset covariances, latched topics, unstamped images."""

from __future__ import annotations

from array import array
from functools import partial
from importlib.util import find_spec
from itertools import cycle
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

pytest.importorskip('rclpy')

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
import rclpy
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import (
    assert_near,
    camera_info,
    frames,
    initial_pose,
    localized,
    parameters,
    send,
    START,
    WORLD,
)  # fmt: skip
from ros_support import PATIENCE
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import Trigger

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.io.map_files import save_map
from gip_localizer.ros.localizer.map_in_use import LoadMap

pytestmark = pytest.mark.ros
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
UNPOSED = {'initial_pose.set': False, 'recovery.automatic': False}


@pytest.fixture
def start(nodes, tester, map_file):
    def begin(changes=None, remappings=(), known=True):
        process = nodes.start('localizer', parameters(map_file, changes), remappings)
        if known:
            tester.until(tester.matched, 'the localizer to join', alive=process)
        return process

    return begin


def lines(tmp_path):
    return (tmp_path / 'localizer.log').read_text().splitlines()


def test_an_initialpose_without_covariance_takes_the_parameters(start, tester, render, tmp_path):
    process = start(UNPOSED)
    unset = initial_pose(START)
    unset.pose.covariance = np.zeros(36)
    tester.initial.publish(unset)
    tester.spin(0.3)
    assert_near(localized(tester, frames(render(START)), process), START)
    assert 'incompatible' not in (tmp_path / 'localizer.log').read_text()


def test_what_was_latched_before_the_start_arrives(nodes, tester, map_file, render):
    tester.create_publisher(CameraInfo, 'camera_info', LATCHED).publish(camera_info())
    posed = tester.create_publisher(PoseWithCovarianceStamped, 'initialpose', LATCHED)
    posed.publish(initial_pose(START))
    process = nodes.start('localizer', parameters(map_file, UNPOSED))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    images = frames(render(START))

    def came():
        tester.image.publish(next(images))
        tester.spin(0.1)
        return tester.poses

    tester.until(came, 'a pose', alive=process)
    assert_near(tester.poses[-1], START)
    figures = {v.key: v.value for v in tester.status('prior').values}
    assert figures['initialposes'] == '1'  # of two subscriptions, one uses it


def test_the_compressed_topic_follows_the_image_and_is_named_with_its_publishers(
    start, tester, tmp_path
):
    start({'image_transport': 'compressed', 'image_reliability': 'reliable'},
          ['image:=/front/image_raw'], known=False)  # fmt: skip
    topic = '/front/image_raw/compressed'
    tester.until(lambda: tester.said('camera', f'nothing publishes {topic}'), 'the topic')
    assert any(f'waiting for {topic}' in line for line in lines(tmp_path))
    lossy = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    tester.create_publisher(CompressedImage, topic, lossy)
    words = f'1 publisher of {topic}, none compatible: offered best_effort, volatile'
    tester.until(lambda: tester.said('camera', words), 'why it is not heard')


def test_a_video_is_localized_and_a_lost_packet_is_named(start, tester, render):
    pytest.importorskip('av', reason='PyAV is the extra `video`')
    from video_samples import encoded

    picture = render(START)
    process = start({'image_transport': 'compressed'}, known=False)
    camera = tester.create_publisher(CompressedImage, 'image/compressed', 10)
    tester.until(camera.get_subscription_count, 'the localizer', alive=process)
    packets = cycle(encoded('h264', [picture] * 5, gop=5))
    stamps = (image.header.stamp for image in frames(picture))

    def send_packet(packet):
        tester.info.publish(camera_info())
        message = CompressedImage(format='h264', data=array('B', packet))
        message.header.stamp = next(stamps)
        camera.publish(message)
        tester.spin(0.1)

    def came():
        send_packet(next(packets))
        return len(tester.poses) >= 3

    tester.until(came, 'poses', alive=process)
    assert_near(tester.poses[-1], START)

    def named():
        """Leave one packet out, and wait for the diagnostics of every second."""
        next(packets)
        for _ in range(2):
            send_packet(next(packets))
            tester.spin(1.2)
            if tester.said('camera', 'lacks a packet before this one'):
                return True
        for _ in range(4):
            send_packet(next(packets))
        return False

    tester.until(named, 'a report of the lost packet', alive=process)


def test_foxglove_video_is_localized_or_refused_by_name(start, tester, render, tmp_path):
    process = start({'image_transport': 'foxglove'}, known=False)
    if find_spec('foxglove_msgs') is None:
        assert process.wait(PATIENCE) == 1
        assert 'the package foxglove_msgs is not installed' in lines(tmp_path)[-1]
        return
    pytest.importorskip('av', reason='PyAV is the extra `video`')
    from foxglove_msgs.msg import CompressedVideo
    from video_samples import encoded

    camera = tester.create_publisher(CompressedVideo, 'image/foxglove', 10)
    tester.until(camera.get_subscription_count, 'the localizer', alive=process)
    picture = render(START)
    packets = cycle(encoded('h265', [picture] * 10, gop=10))
    stamps = (image.header.stamp for image in frames(picture))

    def came():
        tester.info.publish(camera_info())
        camera.publish(CompressedVideo(timestamp=next(stamps), frame_id='camera', format='h265',
                                       data=array('B', next(packets))))
        tester.spin(0.1)
        return len(tester.poses) >= 3

    tester.until(came, 'poses', alive=process)
    assert_near(tester.poses[-1], START)


def test_images_that_are_never_stamped_give_no_pose_and_say_so(start, tester, render):
    process = start()
    [unstamped] = [next(frames(render(START), 0))]

    def said():
        send(tester, unstamped, process)
        return tester.said('camera', 'BAD_IMAGE: images are not stamped')

    tester.until(said, 'the reason', alive=process)
    assert tester.poses == []
    assert not tester.said('camera', 'LATE_FRAMES')


def test_a_topic_that_sounds_rectified_is_doubted(start, tester, render):
    process = start(None, ['image:=/front/image_rect'], known=False)
    camera = tester.create_publisher(Image, '/front/image_rect', 10)
    images = frames(render(START))

    def said():
        tester.info.publish(camera_info())
        camera.publish(next(images))
        tester.spin(0.1)
        return tester.said('calibration', 'RECTIFIED_DIFFERS: /front/image_rect')

    tester.until(said, 'the doubt', alive=process)


def test_states_that_flap_flood_neither_the_log_nor_the_diagnostics(
    start, tester, render, tmp_path
):
    """Every second frame black, every fifth a repetition, odometry and poses in wrong frames."""
    process = start()
    good = render(START)
    localized(tester, frames(good), process)
    images, last = enumerate(frames(good, 1_800_000_000 * 10**9)), None
    before, heard, began = len(lines(tmp_path)), len(tester.diagnostics), time.monotonic()
    groups = ('camera', 'match', 'odometry', 'prior')

    def logged():
        said = lines(tmp_path)[before:]
        return all(any(f' {group}: ' in line for line in said) for group in groups)

    while (elapsed := time.monotonic() - began) < 5.0 or not logged():
        assert elapsed < PATIENCE, lines(tmp_path)[before:]
        number, image = next(images)
        if number % 2:
            image.data = type(image.data)('B', bytes(len(image.data)))
        send(tester, last if last is not None and number % 5 == 0 else image, process)
        last = image
        odometry = Odometry(header=image.header, child_frame_id='trailer')
        tester.odom.publish(odometry)
        tester.initial.publish(initial_pose(START, 'moon'))
    said = lines(tmp_path)[before:]
    assert len(said) <= 20, said
    assert len(tester.diagnostics) - heard <= 5.0 * (time.monotonic() - began) + 2


def test_z_and_tilt_are_those_of_the_initialpose_with_a_variance_that_no_filter_follows(
    start, tester, render
):
    process = start({**UNPOSED, 'attitude.source': 'initialpose'})
    high = initial_pose(START)
    high.pose.pose.position.z = 40.0
    tester.initial.publish(high)
    tester.spin(0.3)
    assert localized(tester, frames(render(START)), process).pose.position.z == 40.0
    tester.until(lambda: tester.with_covariance, 'the covariance')
    variances = np.diag(np.reshape(tester.with_covariance[-1].pose.covariance, (6, 6)))
    assert variances[[2, 3, 4]].tolist() == [1e6, 100.0, 100.0]
    assert tester.set('attitude.sigma_z', 2.0).successful


def test_a_second_node_of_the_same_name_is_noticed(start, tester):
    start()
    other = rclpy.create_node('localizer')
    try:
        words = 'DUPLICATE_NAME: 2 nodes are called /localizer'
        tester.until(lambda: tester.said('output', words), 'the other node')
    finally:
        other.destroy_node()


def test_the_map_changes_while_the_node_runs_and_the_pose_is_carried_over(
    start, tester, render, tmp_path
):
    process = start()
    images = frames(render(START))
    localized(tester, images, process)
    refused = tester.set('map_file', '/nowhere/map.yaml')
    assert not refused.successful
    assert '/nowhere/map.yaml' in refused.reason
    assert_near(localized(tester, images, process), START)
    turned = tmp_path / 'other.yaml'
    save_map(RasterMap(WORLD.grey[:, :-25], WORLD.resolution, WORLD.origin), turned)
    published = len(tester.maps)
    assert tester.set('map_file', str(turned)).successful
    tester.until(lambda: len(tester.maps) > published, 'the other map')
    assert tester.maps[-1].info.width == WORLD.grey.shape[1] - 25
    assert_near(localized(tester, images, process), START)


@pytest.mark.parametrize('service_type', ['nav2_msgs.srv', 'nav_msgs.srv'])
def test_load_map_takes_another_map_or_says_why_not(start, tester, render, tmp_path, service_type):
    kind = pytest.importorskip(service_type, reason='nav2_msgs is not in the wheels').LoadMap
    if kind is not LoadMap:
        pytest.skip('nav2_msgs is installed, and the service is of it')
    process = start()
    images = frames(render(START))
    localized(tester, images, process)
    other = tmp_path / 'other map.yaml'
    save_map(RasterMap(WORLD.grey[:, :-25], WORLD.resolution, WORLD.origin), other)
    no_picture, no_map = tmp_path / 'no_picture.yaml', tmp_path / 'no_map.yaml'
    no_picture.write_text(other.read_text().replace('other map', 'absent'))
    no_map.write_text('resolution: 0.04\n')
    codes = kind.Response
    for url, result in (
        ('/nowhere/map.yaml', codes.RESULT_MAP_DOES_NOT_EXIST),
        ('package://no_such_package/map.yaml', codes.RESULT_MAP_DOES_NOT_EXIST),
        ('http://127.0.0.1/map.yaml', codes.RESULT_MAP_DOES_NOT_EXIST),
        (str(no_picture), codes.RESULT_INVALID_MAP_DATA),
        (f'file://{no_map}', codes.RESULT_INVALID_MAP_METADATA),
    ):
        request = kind.Request(map_url=url)
        assert tester.ask(kind, '/localizer/load_map', request).result == result
    assert_near(localized(tester, images, process), START)
    url = 'file://' + str(other).replace(' ', '%20')
    answer = tester.ask(kind, '/localizer/load_map', kind.Request(map_url=url))
    assert answer.result == codes.RESULT_SUCCESS
    assert answer.map.info.width == WORLD.grey.shape[1] - 25
    assert tester.get('map_file') == str(other)
    assert_near(localized(tester, images, process), START)
    said = [line for line in lines(tmp_path) if 'load_map' in line]
    assert any('no such file' in line for line in said)
    assert any('absent' in line for line in said)
    assert sum('is of nav_msgs/srv/LoadMap' in line for line in said) == (
        'nav2' not in service_type)


def test_relocalize_is_refused_with_its_reason_while_images_are_ignored(start, tester):
    start()
    assert tester.trigger('/localizer/relocalize').success
    assert tester.switch('/localizer/enable', False).success
    answer = tester.trigger('/localizer/relocalize')
    assert not answer.success
    assert '~/enable' in answer.message


def test_relocalize_and_wait_answers_with_the_outcome(start, tester, render):
    process = start(UNPOSED)
    client = tester.create_client(Trigger, '/localizer/relocalize_and_wait')
    tester.until(client.service_is_ready, 'the service')
    tester.spin(0.2)

    def answer(images):
        asked = client.call_async(Trigger.Request())
        tester.until(lambda: send(tester, next(images), process) or asked.done(), 'an answer')
        return asked.result()

    found = answer(frames(render(START)))
    assert found.success
    assert found.message.startswith(('found: x 1.00', 'found: x 0.99'))
    grey = np.full((240, 320), 90, np.uint8)
    lost = answer(frames(grey, 1_800_000_000 * 10**9))
    assert not lost.success
    assert lost.message.startswith('not found: LOW_CONTRAST')
    assert tester.switch('/localizer/enable', False).success
    assert '~/enable' in tester.trigger('/localizer/relocalize_and_wait').message


def test_ctrl_c_amid_the_imports_is_quiet(tmp_path):
    raster_map = Path(__file__).parents[1] / 'bags' / 'demo' / 'map.yaml'
    command = [sys.executable, '-X', 'importtime', '-c',
               'import sys; from gip_localizer.ros.entry import localizer; sys.exit(localizer())',
               '--ros-args', '-p', f'map_file:={raster_map}']
    log = tmp_path / 'log'
    # A shell's `&` hands on an ignored SIGINT, which the node would respect.
    listen = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with log.open('w') as out:
        process = subprocess.Popen(command, stderr=out, env=os.environ, preexec_fn=listen)
    try:
        deadline = time.monotonic() + PATIENCE
        while 'numpy' not in log.read_text() and time.monotonic() < deadline:
            time.sleep(0.005)  # the import of rclpy and SciPy is still to come
        process.send_signal(signal.SIGINT)
        assert process.wait(PATIENCE) == 0
    finally:
        process.kill()
        process.wait()
    assert 'Traceback' not in log.read_text()
