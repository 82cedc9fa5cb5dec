# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Odometry and frames that cannot be right, on a drive: each is named, no pose is harmed."""

from __future__ import annotations

import math

from message_samples import camera_info, image_message, initial_pose, odometry_message
import pytest
from test_frontend import CALIBRATION, CAMERA, COVARIANCE, PARAMETERS, S

from gip_localizer.core.estimate import Status
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.io.bags.writer import make_pose
from gip_localizer.session.frontend import Frontend

MS = 1_000_000
EPOCH = 1_700_000_000 * S
FRAMES = 16
SPEED = 5.0
"""Metres a second: more in a tenth of it than `search.x` reaches."""
DAYS_66 = 66 * 86_400 * S


@pytest.fixture(scope='module')
def drive(road):
    """Poses and pictures of a drive at 10 Hz along the road."""
    poses = [pose_at(road, n) for n in range(FRAMES)]
    return [(pose, road.frame(CAMERA, pose, seed=n)) for n, pose in enumerate(poses)]


def pose_at(road, turn):
    """Where the vehicle is after so many tenths of a second."""
    return road.pose(0.1 + SPEED * 0.1 * turn / road.lane.length)


class Run:
    """A drive through a frontend, with odometry at 50 Hz that a test bends."""

    def __init__(self, road, drive):
        self.frontend = Frontend(road.map, PARAMETERS)
        self.frontend.on_camera_info(camera_info(CALIBRATION))
        self.frontend.on_initial_pose(initial_pose(drive[0][0], COVARIANCE))
        self.road, self.drive = road, drive
        self.estimates, self.warnings, self.complaints = [], set(), []
        self.contradicted_at = None

    def go(self, bend=None, show=None):
        """Drive; `bend` makes the messages of one true reading of odometry."""
        for n, (_, pixels) in enumerate(self.drive):
            stamp = EPOCH + n * 100 * MS
            for part in range(-4, 1) if bend else ():
                self._odometry(bend, stamp + part * 20 * MS, n + 0.2 * part)
            self.see(stamp, pixels if show is None else show(n))
        return self

    def see(self, stamp, pixels):
        estimate = self.frontend.on_image(image_message(pixels, 'mono8', stamp_ns=stamp))
        self.estimates.append(estimate)
        self.warnings |= set(self.frontend.warnings)
        if 'ODOMETRY_CONTRADICTED' in self.warnings and self.contradicted_at is None:
            self.contradicted_at = len(self.estimates) - 1
        return estimate

    def _odometry(self, bend, stamp, turn):
        start = pose_at(self.road, 0)
        message = odometry_message(
            stamp, start.inverse() @ pose_at(self.road, turn), forward=SPEED
        )
        for bent in bend(message, turn):
            self.frontend.on_odometry(bent)
            if 'odom' in self.frontend.complaints:
                self.complaints.append(self.frontend.complaints['odom'])

    def assert_right(self):
        """Every frame is published, where the vehicle was."""
        for (pose, _), estimate in zip(self.drive, self.estimates, strict=True):
            assert estimate.published, (estimate.stamp_ns - EPOCH, estimate.reason)
            apart = difference(estimate.pose, pose)
            assert math.hypot(apart[0], apart[1]) < 0.04
            assert abs(apart[2]) < 0.005


@pytest.fixture(scope='module')
def without_odometry(road, drive):
    """Estimates of the drive at 5 and at 10 m/s, by the velocity alone."""
    return {every: Run(road, drive[::every]).go().estimates for every in (1, 2)}


@pytest.fixture
def run(road, drive):
    return Run(road, drive)


def placed(message, x, forward=None):
    message.pose.pose.position.x = x
    if forward is not None:
        message.twist.twist.linear.x = forward
    return message


def at_rest(message, pose=None):
    message.pose.pose = make_pose(pose or Pose2(0.0, 0.0, 0.0))
    message.twist.twist.linear.x = 0.0
    return message


def shifted(message, ns):
    stamp = message.header.stamp.sec * S + message.header.stamp.nanosec + ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, S)
    return message


def named(message, **frames):
    message.header.frame_id = frames.get('frame', 'odom')
    message.child_frame_id = frames.get('child', 'base_link')
    return message


def test_good_odometry_and_a_good_camera_raise_no_doubt(run):
    run.go(lambda message, turn: [message]).assert_right()
    assert not run.warnings
    assert not run.complaints
    assert run.frontend.localizer.state.pose_filter.prediction_source == 'odometry'


@pytest.mark.parametrize('reset', [False, True])
def test_odometry_that_freezes_is_contradicted(run, reset):
    last = pose_at(run.road, 0).inverse() @ pose_at(run.road, 8)
    frozen = Pose2(last.x, last.y, last.yaw + 2.0 * reset)
    run.go(lambda message, turn: [message if turn < 8 else at_rest(message, frozen)])
    run.assert_right()
    assert 'ODOMETRY_CONTRADICTED' in run.warnings
    assert run.frontend.localizer.state.pose_filter.prediction_source == 'constant velocity'


def test_odometry_that_stands_at_zero_all_the_time_is_contradicted(road, drive):
    slow = [(pose, pixels) for pose, pixels in drive[:1] * 2]
    step = 0.25 / road.lane.length
    slow += [(pose := road.pose(0.1 + step * n), road.frame(CAMERA, pose, seed=n))
             for n in range(1, FRAMES)]
    slow[1] = (slow[1][0], road.frame(CAMERA, slow[1][0], seed=99))
    run = Run(road, slow).go(lambda message, turn: [at_rest(message)])
    run.assert_right()
    assert 'ODOMETRY_CONTRADICTED' in run.warnings


BENT = {
    'zero': lambda moved: Pose2(0.0, 0.0, 0.0),
    'a tenth': lambda moved: Pose2(0.1 * moved.x, 0.1 * moved.y, moved.yaw),
    'double': lambda moved: Pose2(2.0 * moved.x, 2.0 * moved.y, moved.yaw),
    'backward': lambda moved: Pose2(-moved.x, moved.y, -moved.yaw),
    'yaw only': lambda moved: Pose2(0.0, 0.0, moved.yaw),
}


@pytest.mark.parametrize('every', [1, 2])  # 5 and 10 m/s
@pytest.mark.parametrize('kind', BENT)
def test_wrong_odometry_changes_no_pose_of_a_vehicle_that_drives_from_the_start(
    road, drive, without_odometry, kind, every
):
    start = pose_at(road, 0)

    def bent(message, turn):
        reported = BENT[kind](start.inverse() @ pose_at(road, every * turn))
        message.pose.pose = make_pose(reported)
        return [message]

    run = Run(road, drive[::every]).go(bent)
    for estimate, other in zip(run.estimates, without_odometry[every], strict=True):
        assert estimate.published == other.published
        apart = difference(estimate.pose, other.pose)
        assert math.hypot(apart[0], apart[1]) < 0.002
    assert 'ODOMETRY_CONTRADICTED' in run.warnings
    assert run.contradicted_at == 2  # the second fix shows the motion; the warning comes next


def test_odometry_that_is_right_again_is_believed_once_it_agrees(road, drive):
    run = Run(road, drive).go(lambda message, turn: [message if turn < 3 else at_rest(message)])
    assert 'ODOMETRY_CONTRADICTED' in run.frontend.warnings
    check = run.frontend.localizer.state.pose_filter.odometry_check
    driven = Pose2(SPEED, 0.0, 0.0)
    for _ in range(3):
        check.compare(driven, driven, sigma_xy=0.01, sigma_yaw=0.001, elapsed=1.0)
    run.see(EPOCH + FRAMES * 100 * MS, drive[-1][1])
    assert 'ODOMETRY_CONTRADICTED' not in run.frontend.warnings


@pytest.mark.parametrize('ns', [DAYS_66, -DAYS_66])
def test_odometry_of_another_day_is_named(run, ns):
    run.go(lambda message, turn: [shifted(message, ns)]).assert_right()
    assert run.warnings == {'ODOMETRY_OFF_TIME'}
    assert '66.0 days' in run.frontend.warnings['ODOMETRY_OFF_TIME']


@pytest.mark.parametrize('ns', [DAYS_66, -DAYS_66])
def test_one_stamp_of_another_day_does_not_cost_the_rest(run, ns):
    run.go(lambda message, turn: [message, *(
        [shifted(odometry_message(EPOCH, Pose2(0.0, 0.0, 0.0)), ns)] if turn == 9 else [])])
    run.assert_right()
    assert 'ODOMETRY_CONTRADICTED' not in run.warnings


@pytest.mark.parametrize(('frames', 'words'), [
    ({'frame': 'map'}, "in frame 'map', expected frames.odom 'odom'"),
    ({'child': 'trailer'}, "of frame 'trailer', expected frames.base 'base_link'"),
])
def test_odometry_in_another_frame_is_refused(run, frames, words):
    run.go(lambda message, turn: [named(message, **frames)]).assert_right()
    assert words in run.complaints[0]
    assert run.frontend.counts['odom_refused'] == run.frontend.counts['odom']


BENDS = {
    'jumped 10': lambda m, turn: [placed(m, m.pose.pose.position.x + 10.0 * (turn >= 8))],
    'jumped 9.9': lambda m, turn: [placed(m, m.pose.pose.position.x + 10.0 * (turn == 8))],
    'NaN': lambda m, turn: [placed(m, math.nan) if turn == 8 else m],
    'repeats the stamp': lambda m, turn: [m, m],
    'before the last': lambda m, turn: [m, shifted(odometry_message(
        EPOCH + round(turn * 100) * MS, Pose2(0.0, 0.0, 0.0)), -100 * MS)],
}


@pytest.mark.parametrize('words', BENDS)
def test_odometry_that_jumps_repeats_or_is_no_number_is_refused(run, words):
    run.go(BENDS[words]).assert_right()
    assert any(words in complaint for complaint in run.complaints), run.complaints


def test_odometry_in_kilometres_an_hour_is_contradicted(run):
    run.go(lambda m, turn: [
        placed(m, m.pose.pose.position.x * (3.6 if turn > 8 else 1.0), 3.6 * SPEED)])
    run.assert_right()
    assert run.complaints or 'ODOMETRY_CONTRADICTED' in run.warnings


def test_a_frozen_camera_publishes_nothing_while_odometry_tells_of_motion(run):
    run.go(lambda message, turn: [message], show=lambda n: run.drive[min(n, 8)][1])
    statuses = [estimate.status for estimate in run.estimates]
    assert statuses == [Status.TRACKING] * 9 + [Status.FROZEN_IMAGE] * (FRAMES - 9)
    assert 'camera is frozen' in run.estimates[-1].reason


def test_a_frozen_camera_is_noticed_by_the_velocity_alone_and_thawed_by_new_pixels(run):
    run.go(show=lambda n: run.drive[min(n, 8) if n < 11 else n][1])
    statuses = [estimate.status for estimate in run.estimates]
    assert statuses[9:11] == [Status.FROZEN_IMAGE] * 2
    assert statuses[11:] == [Status.TRACKING] * (FRAMES - 11)


def test_the_same_pixels_while_the_vehicle_stands_are_told_and_localized(run):
    run.go(lambda message, turn: [at_rest(message)], show=lambda n: run.drive[0][1])
    assert all(estimate.published for estimate in run.estimates)
    assert run.warnings == {'REPEATED_IMAGES'}


@pytest.mark.parametrize('back_ms', [0, 100, 900])
def test_a_frame_of_an_earlier_or_the_same_time_is_skipped(run, back_ms):
    run.go(lambda message, turn: [message])
    old = run.see(EPOCH + (FRAMES - 1) * 100 * MS - back_ms * MS, run.drive[3][1])
    assert old.status is Status.OUT_OF_ORDER
    run.estimates.pop()
    run.assert_right()
