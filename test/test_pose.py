# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from gip_localizer.core.pose import difference, interpolate, Pose2, wrap_angle

metres = st.floats(-1e4, 1e4)
angles = st.floats(-20.0, 20.0)
poses = st.builds(Pose2, metres, metres, angles)
ROUNDING = 1e-8  # m: double precision at 20 km


def matrix(pose: Pose2) -> np.ndarray:
    full = np.eye(3)
    full[:2, :2], full[:2, 2] = pose.rotation(), (pose.x, pose.y)
    return full


def assert_same(a: Pose2, b: Pose2) -> None:
    np.testing.assert_allclose(difference(a, b), 0.0, atol=ROUNDING)


@given(poses)
def test_a_pose_times_its_inverse_is_the_identity(pose):
    assert_same(pose @ pose.inverse(), Pose2(0.0, 0.0, 0.0))
    assert_same(pose.inverse() @ pose, Pose2(0.0, 0.0, 0.0))


@given(poses, poses, poses)
def test_composition_is_associative_and_is_the_product_of_matrices(a, b, c):
    assert_same((a @ b) @ c, a @ (b @ c))
    np.testing.assert_allclose(matrix(a @ b), matrix(a) @ matrix(b), atol=1e-7)


@given(poses, st.lists(st.tuples(metres, metres), min_size=1, max_size=5))
def test_points_come_back_through_the_inverse(pose, points):
    xy = np.array(points)
    np.testing.assert_allclose(pose.inverse().transform(pose.transform(xy)), xy, atol=ROUNDING)


@given(angles)
def test_wrapping_is_idempotent_and_keeps_the_direction(angle):
    wrapped = wrap_angle(angle)
    assert -math.pi <= wrapped < math.pi
    assert wrap_angle(wrapped) == pytest.approx(wrapped, abs=1e-12)
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-12)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-12)


@given(poses, poses)
def test_interpolation_starts_and_ends_at_its_ends(start, end):
    assert_same(interpolate(start, end, 0.0), start)
    assert_same(interpolate(start, end, 1.0), end)


def test_interpolation_turns_the_short_way():
    middle = interpolate(Pose2(0.0, 0.0, 3.0), Pose2(2.0, 0.0, -3.0), 0.5)
    assert middle.x == 1.0
    assert abs(middle.yaw) == pytest.approx(math.pi)


def test_a_known_composition():
    ahead_of_a_turned_car = Pose2(1.0, 2.0, math.pi / 2) @ Pose2(3.0, 0.0, 0.1)
    assert ahead_of_a_turned_car == pytest.approx((1.0, 5.0, math.pi / 2 + 0.1))


def test_difference_wraps_the_heading():
    d = difference(Pose2(1.0, 2.0, 3.1), Pose2(0.0, 0.0, -3.1))
    np.testing.assert_allclose(d, [1.0, 2.0, 6.2 - 2 * math.pi])


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf])
def test_only_finite_poses_are_finite(bad):
    assert Pose2(1.0, 2.0, 3.0).is_finite()
    for index in range(3):
        numbers = [0.0, 0.0, 0.0]
        numbers[index] = bad
        assert not Pose2(*numbers).is_finite()
