# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from evo.core.trajectory import PoseTrajectory3D
from evo.tools import file_interface
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
import pytest

from gip_localizer.core.pose import Pose2
from gip_localizer.errors import OutputError, TrajectoryError
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import read_tum, write_tum

GOOD = '1.0 0 0 0 0 0 0 1\n2.0 1 0 0 0 0 0 1\n'


def straight(count: int = 5, step_ns: int = 100_000_000) -> Trajectory:
    stamps = 1_700_000_000_123_456_789 + step_ns * np.arange(count)
    return Trajectory.from_samples(
        (int(stamp), Pose2(float(i), 2.0 * i, 0.1 * i)) for i, stamp in enumerate(stamps)
    )


def test_nanoseconds_and_poses_survive_the_file(tmp_path):
    path = tmp_path / 'a.tum'
    written = straight()
    write_tum(path, written)
    read = read_tum(path)
    np.testing.assert_array_equal(read.stamps_ns, written.stamps_ns)
    np.testing.assert_allclose(read.poses, written.poses, atol=1e-12)


def test_evo_reads_the_file(tmp_path):
    path = tmp_path / 'a.tum'
    written = straight()
    write_tum(path, written)
    read: PoseTrajectory3D = file_interface.read_tum_trajectory_file(path)
    np.testing.assert_allclose(read.positions_xyz[:, :2], written.poses[:, :2], atol=1e-12)
    assert read.check()[0]


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 1.0), st.floats(-math.pi, math.pi), st.floats(-1.5, 1.5))
def test_yaw_is_interpolated_the_short_way(fraction, yaw, turn):
    path = Trajectory.from_samples([(0, Pose2(0, 0, yaw)), (10**9, Pose2(1, -2, yaw + turn))])
    stamp = round(fraction * 1e9)
    x, y, heading = path.at(np.array([stamp]))[0]
    assert x == pytest.approx(stamp * 1e-9)
    assert y == pytest.approx(-2e-9 * stamp)
    assert math.remainder(heading - yaw - turn * stamp * 1e-9, math.tau) == pytest.approx(
        0.0, abs=1e-9
    )


def test_nothing_is_known_outside_or_in_a_long_gap():
    path = Trajectory.from_samples(
        [(10, Pose2(0, 0, 0)), (20, Pose2(1, 0, 0)), (10_000_000_020, Pose2(2, 0, 0))]
    )
    poses = path.at(np.array([9, 10, 15, 20, 5_000_000_000, 10_000_000_020, 10_000_000_021]))
    known = np.isfinite(poses).all(axis=1)
    assert known.tolist() == [False, True, True, True, False, True, False]


def test_poses_at_other_stamps_change_no_path():
    path = straight()
    other = np.concatenate([path.stamps_ns - 30_000_000, path.stamps_ns[::-1]])
    dense = path.with_stamps(other)
    assert len(dense) == 9  # the one before the first pose is not known
    assert (np.diff(dense.stamps_ns) > 0).all()
    np.testing.assert_allclose(dense.at(path.stamps_ns), path.poses, atol=0.0)
    np.testing.assert_allclose(dense.at(other), path.at(other), atol=1e-12)


def test_an_empty_trajectory_knows_nothing():
    assert np.isnan(Trajectory.from_samples([]).at(np.array([1, 2]))).all()


def test_samples_are_sorted_and_the_last_of_a_stamp_stays():
    path = Trajectory.from_samples([(2, Pose2(2, 0, 0)), (1, Pose2(1, 0, 0)), (2, Pose2(3, 0, 0))])
    assert path.stamps_ns.tolist() == [1, 2]
    assert path.poses[:, 0].tolist() == [1.0, 3.0]


@pytest.mark.parametrize(('line', 'words'), [
    ('3.0 1 2 3', '4 columns'),
    ('3.0,1,2,3,0,0,0,1', '1 columns'),
    ('3.0 a 0 0 0 0 0 1', 'not eight numbers'),
    ('x 1 0 0 0 0 0 1', 'not eight numbers'),
    ('3.0 nan 0 0 0 0 0 1', 'not finite'),
    ('inf 0 0 0 0 0 0 1', 'not finite'),
    ('3.0 0 0 0 0 0 0 0', 'quaternion'),
    ('1.5 0 0 0 0 0 0 1', 'not after'),
    ('2.0 0 0 0 0 0 0 1', 'not after'),
    ('1700000000123456789 0 0 0 0 0 0 1', 'stamp'),
])
def test_a_malformed_line_is_named(tmp_path, line, words):
    path = tmp_path / 'truth.tum'
    path.write_text(f'# stamp x y z qx qy qz qw\n{GOOD}{line}\n')
    with pytest.raises(TrajectoryError, match=words) as caught:
        read_tum(path)
    assert f'{path}:4: ' in str(caught.value)


@pytest.mark.parametrize('content', [b'', b'# only a comment\n', b'\xff\xfe\x00binary\x80'])
def test_a_file_without_poses_is_refused(tmp_path, content):
    path = tmp_path / 'truth.tum'
    path.write_bytes(content)
    with pytest.raises(TrajectoryError, match=r'truth\.tum'):
        read_tum(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(TrajectoryError, match='none'):
        read_tum(tmp_path / 'none.tum')


def test_an_unwritable_place_is_refused(tmp_path):
    with pytest.raises(OutputError, match='absent'):
        write_tum(tmp_path / 'absent' / 'a.tum', straight())


def test_a_byte_order_mark_is_passed_over(tmp_path):
    path = tmp_path / 'a.txt'
    path.write_bytes(b'\xef\xbb\xbf1.5 1 2 0 0 0 0 1\r\n2.5 2 2 0 0 0 0 1\r\n')
    assert read_tum(path).stamps_ns.tolist() == [1_500_000_000, 2_500_000_000]


@pytest.mark.parametrize(('stamp', 'unit'), [
    ('1700000000000000000', 'nanoseconds'), ('1700000000000000', 'microseconds'),
    ('1700000000000.0', 'milliseconds'),
])
def test_stamps_of_another_unit_are_named(tmp_path, stamp, unit):
    path = tmp_path / 'a.txt'
    path.write_text(f'{stamp} 1 2 0 0 0 0 1\n')
    with pytest.raises(TrajectoryError, match=f'a.txt:1: .*stamps look like {unit}'):
        read_tum(path)


def test_a_quaternion_with_w_first_is_doubted(tmp_path):
    path = tmp_path / 'a.txt'
    lines = [f'{i} {i} 0 0 {math.cos(i / 20):.9f} 0 0 {math.sin(i / 20):.9f}' for i in range(9)]
    path.write_text('\n'.join(lines))
    with pytest.raises(TrajectoryError, match='degrees are beyond any road; is it "qw qx qy qz"'):
        read_tum(path)


@pytest.mark.parametrize(('axis', 'angle', 'fits'), [
    ('x', 0.3, True), ('y', -0.35, True), ('x', 0.9, False), ('y', 1.2, False),
    ('x', math.pi, False),
])
def test_roll_and_pitch_are_those_of_a_road(tmp_path, axis, angle, fits):
    path = tmp_path / 'a.txt'
    sin, cos = math.sin(angle / 2), math.cos(angle / 2)
    path.write_text(f'1 1 2 0 {sin if axis == "x" else 0} {sin if axis == "y" else 0} 0 {cos}\n')
    if fits:
        assert len(read_tum(path)) == 1
    else:
        with pytest.raises(TrajectoryError, match='beyond any road'):
            read_tum(path)
