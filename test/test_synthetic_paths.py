# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths by arc length, and motions along them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.errors import TrajectoryError
from gip_localizer.synthetic.motions import LineMotion, make_motion, PathMotion
from gip_localizer.synthetic.parameters import Drive
from gip_localizer.synthetic.paths import Path, rectangle_loop

CIRCLE = Path(
    np.column_stack([f(np.linspace(0, 2 * np.pi, 200, endpoint=False)) * 8.0
                     for f in (np.cos, np.sin)]),
    closed=True,
)
LOOP = rectangle_loop(np.array([0.0, 0.0]), np.array([30.0, 20.0]), 3.0)
MOTIONS = [PathMotion(CIRCLE, 4.0, 1.0), PathMotion(LOOP, 5.0), LineMotion(Pose2(1, 2, 0.5), 3.0)]


def test_circle_has_its_length_heading_and_curvature():
    assert CIRCLE.length == pytest.approx(2 * np.pi * 8.0, rel=1e-4)
    quarter = CIRCLE.pose(CIRCLE.length / 4)
    assert np.allclose(quarter[:2], [0.0, 8.0], atol=1e-4)
    assert abs(quarter.yaw) == pytest.approx(np.pi, abs=1e-4)
    assert CIRCLE.curvature(7.0) == pytest.approx(1 / 8.0, rel=1e-3)


def test_a_loop_closes_smoothly():
    start, end = LOOP.pose(0.0), LOOP.pose(LOOP.length - 1e-9)
    assert np.allclose(difference(end, start), 0.0, atol=1e-6)
    assert LOOP.curvature(1e-9) == pytest.approx(LOOP.curvature(LOOP.length - 1e-9), abs=1e-6)
    turns = np.sum([LOOP.curvature(s) for s in LOOP.stations]) * LOOP.length / len(LOOP.stations)
    assert turns == pytest.approx(2 * np.pi, rel=1e-3)


def test_a_shifted_path_keeps_its_distance_to_the_left():
    outside = CIRCLE.shifted(-2.0)
    assert np.allclose(np.linalg.norm(outside.position(outside.stations), axis=1), 10.0, atol=1e-3)


@pytest.mark.parametrize('motion', MOTIONS)
def test_twist_is_the_derivative_of_the_pose(motion):
    for time in (0.0, 1.7, 9.3, 40.0):
        step = motion.pose(time).inverse() @ motion.pose(time + 1e-4)
        twist = motion.twist(time + 0.5e-4)
        expected = np.array([twist.forward, twist.left, twist.turn])
        assert np.allclose(np.array(step) / 1e-4, expected, rtol=2e-3, atol=2e-3)


def test_open_path_ends():
    straight = Path(np.array([[0.0, 0.0], [5.0, 0.0], [10.0, 0.0]]), closed=False)
    assert PathMotion(straight, 2.0, 4.0).duration == pytest.approx(3.0)
    assert PathMotion(LOOP, 2.0).duration == math.inf


def write_tum(path, yaws):
    lines = [
        f'{100 + k * 0.5:.9f} {k} {-k} 0 0 0 {math.sin(yaw / 2)} {math.cos(yaw / 2)}\n'
        for k, yaw in enumerate(yaws)
    ]
    path.write_text('# stamp x y z qx qy qz qw\n' + ''.join(lines))


def test_tum_file_is_driven_in_its_own_time(tmp_path):
    file = tmp_path / 'drive.tum'
    write_tum(file, [0.0, 0.2, 0.4])
    motion = make_motion(Drive(trajectory=str(file)), LOOP)
    assert motion.duration == pytest.approx(1.0)
    assert np.allclose(motion.pose(0.25), [0.5, -0.5, 0.1])
    assert np.allclose(motion.pose(9.0), [2.0, -2.0, 0.4])
    assert motion.twist(0.7).turn == pytest.approx(0.4, rel=1e-6)
    twist = motion.twist(0.25)
    assert math.hypot(twist.forward, twist.left) == pytest.approx(2 * math.sqrt(2), rel=1e-6)


def test_malformed_tum_file_is_refused_by_line(tmp_path):
    file = tmp_path / 'drive.tum'
    write_tum(file, [0.0, 0.1])
    file.write_text(file.read_text() + '101.5 1 2 three 0 0 0 1\n')
    with pytest.raises(TrajectoryError, match=r'drive\.tum:4'):
        make_motion(Drive(trajectory=str(file)), LOOP)
    with pytest.raises(TrajectoryError, match=r'nowhere\.tum'):
        make_motion(Drive(trajectory=str(tmp_path / 'nowhere.tum')), LOOP)
