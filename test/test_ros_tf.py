# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""TF over real DDS, where tf2_msgs is installed; `test/tf_messages/make.sh` generates it."""

from __future__ import annotations

import math

import pytest

pytest.importorskip('rclpy')
pytest.importorskip('tf2_msgs.msg', reason='tf2_msgs is not in the wheels')

from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
import numpy as np
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import (
    assert_near,
    camera_info,
    EXTRINSICS,
    frames,
    localized,
    parameters,
    SECOND,
    START,
)  # fmt: skip
from scipy.spatial.transform import Rotation
from tf2_msgs.msg import TFMessage

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.io.messages import planar_pose, stamp_ns
from gip_localizer.io.static_transforms import StaticTransforms
from gip_localizer.ros.conversions import header_of, pose_of

pytestmark = pytest.mark.ros
IN_ODOM = Pose2(30.0, -7.0, -1.1)


def start(nodes, tester, map_file, changes):
    process = nodes.start('localizer', parameters(map_file, changes))
    tester.until(tester.matched, 'the localizer to join', alive=process)
    return process


def test_map_to_odom_takes_the_odometry_to_the_pose(nodes, tester, map_file, render):
    process = start(nodes, tester, map_file, {
        'tf.publish': True, 'tf.tolerance': 0.25, 'tf.hold': 0.0,
    })
    heard = []
    tester.create_subscription(TFMessage, '/tf', heard.append, 100)
    images = frames(render(START))

    def with_odometry():
        for image in images:
            odometry = Odometry(header=image.header, child_frame_id='base_link')
            odometry.header.frame_id = 'odom'
            odometry.pose.pose = pose_of(IN_ODOM)
            tester.odom.publish(odometry)
            image.header.frame_id = 'camera'
            yield image

    wanted = with_odometry()
    tester.until(lambda: localized(tester, wanted, process) and heard, 'a transform')
    [transform] = heard[-1].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ('map', 'odom')
    at, turned = transform.transform.translation, transform.transform.rotation
    map_odom = Pose2(at.x, at.y, 2.0 * math.atan2(turned.z, turned.w))
    stamp = transform.header.stamp
    pose = next(p for p in tester.poses if p.header.stamp.sec * SECOND
                + p.header.stamp.nanosec + SECOND // 4 == stamp.sec * SECOND + stamp.nanosec)
    base = planar_pose(pose.pose)
    reached = map_odom @ IN_ODOM
    assert reached[:2] == pytest.approx(base[:2], abs=1e-6)
    assert wrap_angle(reached.yaw - base.yaw) == pytest.approx(0.0, abs=1e-6)


def test_the_camera_is_where_static_transforms_put_it(nodes, tester, map_file, render):
    nowhere = {f'camera.{name}': 0.5 for name in ('x', 'y', 'z', 'roll', 'pitch', 'yaw')}
    process = start(nodes, tester, map_file, {**nowhere, 'camera.from_tf': True})
    images = frames(render(START))

    def reported():
        tester.info.publish(camera_info())
        tester.image.publish(next(images))
        tester.executor_.spin_once(timeout_sec=0.05)
        return tester.said('calibration', "no transform connects 'base_link' and 'camera'")

    tester.until(reported, 'a report of the missing transform', alive=process)
    assert tester.poses == []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = tester.create_publisher(TFMessage, '/tf_static', latched)
    mounted = TransformStamped(header=header_of(0, 'base_link'), child_frame_id='camera')
    where, turned = mounted.transform.translation, mounted.transform.rotation
    where.x, where.y, where.z = (float(value) for value in EXTRINSICS.position())
    quaternion = Rotation.from_matrix(np.asarray(EXTRINSICS.rotation())).as_quat()
    turned.x, turned.y, turned.z, turned.w = (float(value) for value in quaternion)
    where.z -= 3.0
    static.publish(TFMessage(transforms=[mounted]))

    def refused():
        tester.image.publish(next(images))
        tester.executor_.spin_once(timeout_sec=0.05)
        return tester.said('calibration', 'parameter camera.z: got -1.8')

    tester.until(refused, 'a report of the camera below the road', alive=process)
    assert tester.set('search.x', 0.5).successful
    where.z += 3.0
    static.publish(TFMessage(transforms=[mounted]))
    assert_near(localized(tester, images, process), START)


def test_the_synthetic_camera_says_on_tf_static_where_it_is_held(nodes, tester):
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    heard = []
    process = nodes.start('synthetic_camera', {
        'publish.wait': True, 'world.name': 'tiles', 'camera.x': 1.2, 'camera.z': 1.4,
        'camera.pitch': 0.3, 'camera.yaw': -0.1,
    })
    # Late on purpose: the transform is latched.
    tester.until(lambda: tester.count_publishers('/tf_static'), 'the camera', alive=process)
    tester.create_subscription(TFMessage, '/tf_static', heard.append, latched)
    tester.until(lambda: heard, 'its mount', alive=process)
    tree = StaticTransforms()
    tree.take(heard[0].transforms)
    held = tree.extrinsics('base_link', 'camera')
    expected = Extrinsics(x=1.2, z=1.4, pitch=0.3, yaw=-0.1)
    assert vars(held) == pytest.approx(vars(expected), abs=1e-9)


def posed_with_odometry(tester, render):
    """Frames, each with the odometry at its stamp."""
    for image in frames(render(START)):
        odometry = Odometry(header=image.header, child_frame_id='base_link')
        odometry.header.frame_id = 'odom'
        odometry.pose.pose = pose_of(IN_ODOM)
        tester.odom.publish(odometry)
        image.header.frame_id = 'camera'
        yield image


def test_the_last_transform_is_sent_on_while_it_is_good_and_no_longer(
    nodes, tester, map_file, render
):
    process = start(nodes, tester, map_file, {'tf.publish': True, 'tf.hold': 2.0})
    heard = []
    tester.create_subscription(TFMessage, '/tf', heard.append, 100)
    images = posed_with_odometry(tester, render)
    tester.until(lambda: localized(tester, images, process) and heard, 'a transform')
    first = len(heard)
    tester.until(lambda: len(heard) >= first + 5, 'the same transform again')
    [last], [before] = heard[-1].transforms, heard[-2].transforms
    assert last.transform == before.transform
    ahead = stamp_ns(last.header) - stamp_ns(before.header)
    assert 0.05 * SECOND < ahead < 2.0 * SECOND
    tester.until(lambda: tester.said('output', 'NO_TF: no pose for tf.hold'), 'its end')
    silent = len(heard)
    tester.spin(0.5)
    assert len(heard) == silent
    assert not tester.said('output', 'TF_CONTESTED')


def test_a_robot_with_a_namespace_has_transforms_of_its_own(nodes, tester, map_file):
    process = nodes.start('localizer', parameters(map_file, {'tf.publish': True}),
                          ['__ns:=/robot', '/tf:=tf', '/tf_static:=tf_static'])
    tester.until(lambda: tester.count_publishers('/robot/tf'), '/robot/tf', alive=process)
    assert not tester.count_publishers('/tf')


def test_a_second_source_of_the_same_transform_is_noticed(nodes, tester, map_file):
    process = start(nodes, tester, map_file, {'tf.publish': True})
    other = tester.create_publisher(TFMessage, '/tf', 10)
    message = TransformStamped(header=header_of(5 * SECOND, 'map'), child_frame_id='odom')

    def noticed():
        other.publish(TFMessage(transforms=[message]))
        tester.spin(0.1)
        return tester.said('output', 'TF_CONTESTED: map to odom')

    tester.until(noticed, 'a report of the other source', alive=process)


def test_a_bad_transform_of_another_frame_and_a_moving_mount_leave_the_camera(
    nodes, tester, map_file, render
):
    nowhere = {f'camera.{name}': 0.5 for name in ('x', 'y', 'z', 'roll', 'pitch', 'yaw')}
    process = start(nodes, tester, map_file, {**nowhere, 'camera.from_tf': True})
    images = frames(render(START))
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    static = tester.create_publisher(TFMessage, '/tf_static', latched)
    moving = tester.create_publisher(TFMessage, '/tf', 10)
    bad = TransformStamped(header=header_of(0, 'base_link'), child_frame_id='horn')
    bad.transform.rotation.w = 0.0
    mounted = TransformStamped(header=header_of(0, 'mount'), child_frame_id='camera')
    where, turned = mounted.transform.translation, mounted.transform.rotation
    where.x, where.y, where.z = (float(value) for value in EXTRINSICS.position())
    quaternion = Rotation.from_matrix(np.asarray(EXTRINSICS.rotation())).as_quat()
    turned.x, turned.y, turned.z, turned.w = (float(value) for value in quaternion)
    where.z -= 0.5
    static.publish(TFMessage(transforms=[bad, mounted]))
    hop = TransformStamped(header=header_of(0, 'base_link'), child_frame_id='mount')
    hop.transform.translation.z, hop.transform.rotation.w = 0.5, 1.0

    def came():
        moving.publish(TFMessage(transforms=[hop]))
        tester.info.publish(camera_info())
        tester.image.publish(next(images))
        tester.spin(0.1)
        return tester.poses

    tester.until(came, 'a pose', alive=process)
    assert_near(tester.poses[-1], START)
