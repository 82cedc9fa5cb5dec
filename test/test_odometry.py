# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math
import pickle

from hypothesis import given
from hypothesis import strategies as st
import pytest

from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.odometry import KEPT_NS, OdometryBuffer, OdometrySample
from gip_localizer.parameters import Motion

MS = 1_000_000
S = 1000 * MS


def on_circle(time: float, *, speed: float = 5.0, turn: float = 0.2) -> Pose2:
    radius = speed / turn
    angle = turn * time
    return Pose2(radius * math.sin(angle), radius * (1 - math.cos(angle)), angle)


def driven(count: int = 50, *, period_ms: int = 20, **motion: float) -> OdometryBuffer:
    buffer = OdometryBuffer(Motion(**motion))
    for i in range(count):
        pose = on_circle(1e-3 * i * period_ms)
        sample = OdometrySample(i * period_ms * MS, pose, 5.0, 0.0, 0.2)
        assert buffer.add(sample)
    return buffer


@given(st.integers(0, 980 * MS), st.integers(0, 980 * MS))
def test_motion_is_what_the_vehicle_did(start, end):
    start, end = sorted((start, end))
    expected = on_circle(start * 1e-9).inverse() @ on_circle(end * 1e-9)
    # between samples 20 ms apart the chord replaces an arc of 10 cm
    assert driven().motion(start, end) == pytest.approx(tuple(expected), abs=2e-4)


@given(st.integers(0, 900 * MS), st.integers(0, 900 * MS), st.integers(0, 900 * MS))
def test_motions_add_up(a, b, c):
    a, b, c = sorted((a, b, c))
    buffer = driven()
    parts = buffer.motion(a, b) @ buffer.motion(b, c)
    assert parts == pytest.approx(tuple(buffer.motion(a, c)), abs=1e-9)


def test_beyond_the_newest_sample_its_twist_is_held_for_a_while():
    buffer = driven()
    last = 49 * 20 * MS
    expected = on_circle(last * 1e-9).inverse() @ on_circle(last * 1e-9 + 0.3)
    assert buffer.motion(last, last + 300 * MS) == pytest.approx(tuple(expected), abs=1e-3)
    assert buffer.motion(last, last + 501 * MS) is None


def test_before_the_oldest_sample_nothing_is_known():
    assert driven().motion(-1, 100 * MS) is None
    assert OdometryBuffer(Motion()).motion(0, 1) is None


def test_a_gap_longer_than_allowed_is_not_bridged():
    buffer = OdometryBuffer(Motion())
    for stamp in (0, 400 * MS, 1000 * MS):
        assert buffer.add(OdometrySample(stamp, Pose2(1e-9 * stamp, 0.0, 0.0)))
    assert buffer.motion(0, 200 * MS) is not None
    assert buffer.motion(0, 700 * MS) is None
    assert buffer.motion(0, 1000 * MS) == pytest.approx((1.0, 0.0, 0.0))


@pytest.mark.parametrize('field', ['pose', 'forward', 'left', 'turn'])
@pytest.mark.parametrize('bad', [math.nan, math.inf])
def test_numbers_that_are_none_are_refused(field, bad):
    buffer = driven()
    before = buffer.motion(0, 900 * MS)
    value = Pose2(0.0, bad, 0.0) if field == 'pose' else bad
    sample = OdometrySample(**{'stamp_ns': 990 * MS, 'pose': Pose2(0, 0, 0), field: value})
    assert not buffer.add(sample)
    assert 'NaN' in buffer.refusal
    assert buffer.refused == 1
    assert buffer.motion(0, 900 * MS) == before


@pytest.mark.parametrize('back_ns', [0, 1, 500 * MS])
def test_stamps_that_step_back_a_little_are_refused(back_ns):
    buffer = driven()
    last = buffer.latest.stamp_ns
    assert not buffer.add(OdometrySample(last - back_ns, Pose2(0.0, 0.0, 0.0)))
    assert ('before the last' if back_ns else 'repeats the stamp') in buffer.refusal
    assert buffer.latest.stamp_ns == last
    assert buffer.add(OdometrySample(last + 20 * MS, on_circle(1e-9 * last + 0.02)))
    assert buffer.refusal == ''


def test_a_restart_of_the_clock_starts_afresh():
    buffer = OdometryBuffer(Motion())
    assert buffer.add(OdometrySample(100 * S, Pose2(50.0, 0.0, 0.0)))
    assert not buffer.add(OdometrySample(0, Pose2(0.0, 0.0, 0.0)))
    assert 'jumps by -100.000 s' in buffer.refusal
    assert buffer.add(OdometrySample(100 * MS, Pose2(0.5, 0.0, 0.0)))
    assert buffer.motion(0, 100 * MS) == pytest.approx((0.5, 0.0, 0.0))
    assert buffer.motion(0, 100 * S) is None


@pytest.mark.parametrize('back_s', [3, 3600, 66 * 86400])
def test_single_stamps_of_long_ago_are_told_and_cost_nothing(back_s):
    buffer = driven()
    for n in range(3):
        last = buffer.latest.stamp_ns
        assert not buffer.add(OdometrySample(last - back_s * S, Pose2(0.0, 0.0, 0.0)))
        assert f'jumps by -{back_s}.000 s' in buffer.refusal
        assert buffer.add(OdometrySample(last + 20 * MS, on_circle(1e-9 * last + 0.02)))
        assert buffer.motion(last - 200 * MS, last) is not None, n
    assert buffer.refused == 3


def test_a_jump_is_told_and_no_motion_leads_across_it():
    buffer = driven()
    last = buffer.latest.stamp_ns
    assert not buffer.add(OdometrySample(last + 20 * MS, Pose2(500.0, 0.0, 0.0)))
    assert 'jumped' in buffer.refusal
    assert buffer.motion(last - 20 * MS, last + 20 * MS) is None
    # after the jump odometry is good again
    assert buffer.add(OdometrySample(last + 40 * MS, Pose2(500.1, 0.0, 0.0)))
    assert buffer.motion(last + 20 * MS, last + 40 * MS) == pytest.approx((0.1, 0.0, 0.0))


def test_stamps_of_zero_are_one_sample_and_then_refused():
    buffer = OdometryBuffer(Motion())
    assert buffer.add(OdometrySample(0, Pose2(0.0, 0.0, 0.0)))
    assert not buffer.add(OdometrySample(0, Pose2(1.0, 0.0, 0.0)))
    assert buffer.motion(0, 0) == pytest.approx((0.0, 0.0, 0.0))


def test_old_samples_are_dropped_and_memory_is_bounded():
    buffer, sizes = OdometryBuffer(Motion()), []
    for i in range(5000):
        assert buffer.add(OdometrySample(i * 20 * MS, Pose2(0.1 * i, 0.0, 0.0)))
        if i % 2500 == 2499:
            sizes.append(len(pickle.dumps(buffer)))
    newest = buffer.latest.stamp_ns
    assert buffer.motion(newest - KEPT_NS, newest) == pytest.approx((100.0, 0.0, 0.0))
    assert buffer.motion(newest - KEPT_NS - S, newest) is None
    assert sizes[1] == pytest.approx(sizes[0], rel=0.05)
