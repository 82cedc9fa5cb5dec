# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from camera_samples import make_calibration
from hypothesis import given
from hypothesis import strategies as st
from message_samples import camera_info, initial_pose, odometry_message, quaternion
import numpy as np
import pytest

from gip_localizer.core.pose import Pose2, wrap_angle
from gip_localizer.errors import CalibrationError
from gip_localizer.io.bags.writer import make_header, make_pose
from gip_localizer.io.messages import (
    calibration,
    full_covariance,
    odometry,
    planar_covariance,
    planar_pose,
    PoseMessageError,
    quaternion_of_yaw,
    stamp_ns,
    UNOBSERVED,
)


@given(st.integers(0, 2**31 - 1), st.integers(0, 999_999_999))
def test_stamps_are_exact(seconds, nanoseconds):
    whole = seconds * 1_000_000_000 + nanoseconds
    assert stamp_ns(make_header(whole, 'map')) == whole


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-math.pi, math.pi))
def test_planar_poses_come_back(x, y, yaw):
    back = planar_pose(make_pose(Pose2(x, y, yaw)))
    assert (back.x, back.y) == (x, y)
    assert wrap_angle(back.yaw - yaw) == pytest.approx(0.0, abs=1e-9)
    assert np.linalg.norm(quaternion_of_yaw(yaw)) == pytest.approx(1.0)


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_yaw_is_the_heading_of_a_tilted_pose_too(yaw, pitch, roll):
    from scipy.spatial.transform import Rotation

    pose = make_pose(Pose2(0.0, 0.0, 0.0))
    q = Rotation.from_euler('ZYX', [yaw, pitch, roll]).as_quat()
    pose.orientation = quaternion(*(float(v) for v in q))
    assert wrap_angle(planar_pose(pose).yaw - yaw) == pytest.approx(0.0, abs=1e-9)


def test_a_quaternion_that_is_nearly_unit_is_forgiven():
    pose = make_pose(Pose2(1.0, 2.0, 0.0))
    pose.orientation = quaternion(0.0, 0.0, 1.05 * math.sin(0.25), 1.05 * math.cos(0.25))
    assert planar_pose(pose).yaw == pytest.approx(0.5)


@pytest.mark.parametrize(('orientation', 'word'), [
    ((0.0, 0.0, 0.0, 0.0), 'length 0'),
    ((0.0, 0.0, 0.0, 0.5), 'length 0.5'),
    ((0.0, 0.0, math.nan, 1.0), 'NaN'),
    ((math.inf, 0.0, 0.0, 1.0), 'NaN or infinity'),
])
def test_quaternions_that_turn_nothing_are_refused(orientation, word):
    pose = make_pose(Pose2(1.0, 2.0, 0.0))
    pose.orientation = quaternion(*orientation)
    with pytest.raises(PoseMessageError, match=word):
        planar_pose(pose)


@pytest.mark.parametrize('x', [math.nan, math.inf])
def test_positions_that_are_nowhere_are_refused(x):
    with pytest.raises(PoseMessageError, match='NaN or infinity'):
        planar_pose(make_pose(Pose2(x, 0.0, 0.0)))


def test_covariances_come_back_from_six_by_six():
    root = np.random.default_rng(1).normal(size=(3, 3))
    covariance = root @ root.T
    full = full_covariance(covariance).reshape(6, 6)
    np.testing.assert_array_equal(planar_covariance(full.ravel()), covariance)
    np.testing.assert_array_equal(np.diag(full)[[2, 3, 4]], UNOBSERVED)
    assert full[0, 5] == covariance[0, 2]  # x and rotation about z, REP 103
    assert not full[np.ix_([0, 1, 5], [2, 3, 4])].any()


def test_odometry_keeps_pose_and_twist():
    sample = odometry(odometry_message(123_456_789_012, Pose2(1.0, 2.0, 0.3), forward=4.0,
                                       turn=-0.2))
    assert sample.stamp_ns == 123_456_789_012
    assert sample.pose == pytest.approx((1.0, 2.0, 0.3))
    assert (sample.forward, sample.left, sample.turn) == (4.0, 0.0, -0.2)


@pytest.mark.parametrize('lens', ['none', 'plumb_bob', 'rational-8', 'equidistant'])
def test_a_calibration_comes_back_from_its_message(lens):
    made = make_calibration(lens, roi=(10, 20, 300, 200), binning=(2, 2))
    assert calibration(camera_info(made)).key() == made.key()


def test_zeros_where_ros_means_nothing():
    message = camera_info(make_calibration(), binning_x=0, binning_y=0, r=np.zeros(9))
    read = calibration(message)
    assert read.binning == (1, 1)
    np.testing.assert_array_equal(read.R, np.eye(3))
    assert read.image_size == (640, 360)


@pytest.mark.parametrize(('changes', 'word'), [
    ({'k': np.zeros(9)}, 'not calibrated'),
    ({'k': np.full(9, np.nan)}, 'NaN'),
    ({'d': np.array([0.1, np.nan, 0.0, 0.0, 0.0])}, 'D holds NaN'),
    ({'distortion_model': 'magic', 'd': np.ones(5)}, "'magic' is unknown"),
    ({'distortion_model': '', 'd': np.ones(4)}, 'unknown'),
    ({'width': 0, 'height': 0}, 'size is 0x0'),
    ({'width': 2**31}, 'too large'),
])
def test_unusable_camera_infos_are_refused(changes, word):
    with pytest.raises(CalibrationError, match=word):
        calibration(camera_info(make_calibration('plumb_bob'), **changes))


def test_messages_of_rclpy_are_read_alike():
    CameraInfo = pytest.importorskip('sensor_msgs.msg').CameraInfo
    Odometry = pytest.importorskip('nav_msgs.msg').Odometry
    made = make_calibration('plumb_bob')
    message = CameraInfo(width=640, height=360, distortion_model='plumb_bob')
    message.k, message.d = made.K.ravel().tolist(), made.D.tolist()
    assert calibration(message).key() == made.key()
    odom = Odometry()
    odom.pose.pose.position.x = 3.0
    odom.twist.twist.linear.x = 2.0
    assert odometry(odom).pose == Pose2(3.0, 0.0, 0.0)
    assert odometry(odom).forward == 2.0
    assert planar_covariance(odom.pose.covariance).shape == (3, 3)


def test_an_initial_pose_carries_its_covariance():
    covariance = np.diag([0.25, 0.5, 0.01])
    message = initial_pose(Pose2(1.0, 2.0, 3.0), covariance)
    np.testing.assert_array_equal(planar_covariance(message.pose.covariance), covariance)


@pytest.mark.parametrize(('changes', 'word'), [
    ({'k': [225.0, 0.0, 142.0, 238.0, 225.0, 89.5, 0.0, 0.0, 1.0]}, 'zeros below the diagonal'),
    ({'k': [225.0, 0.0, 142.0, 0.0, 225.0, 89.5, 0.0, 0.0, 2.0]}, '1 at its end'),
    ({'d': [1e308, 0.0, 0.0, 0.0, 0.0]}, '1e.308, beyond any camera'),
])
def test_matrices_that_no_camera_has_are_refused(changes, word):
    numbers = {name: np.array(values) for name, values in changes.items()}
    with pytest.raises(CalibrationError, match=word):
        calibration(camera_info(make_calibration('plumb_bob'), **numbers))
