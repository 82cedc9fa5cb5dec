# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from gip_localizer.core.belief import Belief, checked_prior, PriorError
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.core.track.pose_filter import PoseFilter
from gip_localizer.parameters import Motion

MS = 1_000_000
SMALL = np.diag([0.01**2, 0.02**2, 0.001**2])


def covariance(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(3, 3)) * [[0.1], [0.1], [0.01]]
    return root @ root.T + 1e-8 * np.eye(3)


def pose_filter(**motion: float) -> PoseFilter:
    made = PoseFilter(Motion(**motion))
    made.reset(Belief(0, Pose2(1.0, 2.0, 0.5), SMALL))
    return made


def believing(made: PoseFilter) -> PoseFilter:
    """Return the filter after its odometry has agreed with fixes."""
    driven = Pose2(5.0, 0.0, 0.0)
    made.odometry_check.compare(driven, driven, sigma_xy=0.01, sigma_yaw=0.001, elapsed=1.0)
    assert made.odometry_check.believed
    return made


def assert_covariance(matrix: np.ndarray) -> None:
    np.testing.assert_array_equal(matrix, matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0


def test_without_a_belief_there_is_no_prediction():
    assert PoseFilter(Motion()).predict(100) is None


def test_odometry_that_has_agreed_with_fixes_carries_the_belief():
    t = believing(pose_filter())
    for i in range(11):
        assert t.odometry.add(OdometrySample(i * 20 * MS, Pose2(7.0 + 0.1 * i, 3.0, 0.0)))
    prior = t.predict(200 * MS)
    expected = Pose2(1.0, 2.0, 0.5) @ Pose2(1.0, 0.0, 0.0)
    assert prior.pose == pytest.approx(tuple(expected))
    assert prior.stamp_ns == 200 * MS
    assert t.prediction_source == 'odometry'


def test_uncertainty_grows_and_swings_with_the_heading():
    t = believing(pose_filter(
        sigma_xy_per_m=0.0, sigma_yaw_per_m=0.0, sigma_xy_per_s=0.0, sigma_yaw_per_s=0.0
    ))
    t.reset(Belief(0, Pose2(0.0, 0.0, 0.0), SMALL))
    for i in range(26):
        assert t.odometry.add(OdometrySample(i * 20 * MS, Pose2(0.4 * i, 0.0, 0.0)))
    moved = t.predict(500 * MS).covariance
    # 10 m on, an error in heading is an error to the side: exact for a straight drive
    np.testing.assert_allclose(moved[1, 1], 0.02**2 + (10.0 * 0.001) ** 2, rtol=1e-9)
    np.testing.assert_allclose(moved[1, 2], 10.0 * 0.001**2, rtol=1e-9)
    np.testing.assert_allclose(moved[0, 0], 0.01**2, rtol=1e-9)


@given(st.integers(0, 100), st.floats(-3.0, 3.0), st.integers(1, 2_000))
def test_predictions_keep_a_covariance_that_is_one_and_never_shrinks(seed, yaw, elapsed_ms):
    t = PoseFilter(Motion())
    start = covariance(seed)
    t.reset(Belief(0, Pose2(5.0, -4.0, yaw), start))
    prior = t.predict(elapsed_ms * MS)
    np.testing.assert_allclose(prior.covariance, prior.covariance.T, atol=1e-15)
    assert np.linalg.eigvalsh(prior.covariance - start)[0] > -1e-12


def test_without_odometry_the_last_velocity_is_held():
    t = pose_filter()
    for i in range(1, 4):
        stamp = i * 100 * MS
        fix = Belief(stamp, Pose2(1.0, 2.0, 0.5) @ Pose2(0.5 * i, 0.0, 0.0), SMALL)
        t.correct(t.predict(stamp), fix, fuse=False)
    prior = t.predict(400 * MS)
    assert t.prediction_source == 'constant velocity'
    assert prior.pose == pytest.approx(tuple(Pose2(1.0, 2.0, 0.5) @ Pose2(2.0, 0.0, 0.0)))
    late = t.predict(300 * MS + 3_000 * MS)
    assert t.prediction_source == 'standstill'
    assert late.pose == pytest.approx(tuple(t.belief.pose))
    assert late.covariance[0, 0] > 0.1


@given(st.integers(0, 500), st.integers(501, 1000), st.integers(0, 2**31))
def test_fusion_is_the_information_sum(a, b, seed):
    P, R = covariance(a), covariance(b)
    prior = Belief(0, Pose2(3.0, -2.0, 3.1), P)
    step = np.random.default_rng(seed).multivariate_normal(np.zeros(3), 0.3 * (P + R))
    measured = Belief(0, Pose2(3.0 + step[0], -2.0 + step[1], 3.1 + step[2]), R)
    t = PoseFilter(Motion())
    fused = t.correct(prior, measured, fuse=True)
    total = np.linalg.inv(np.linalg.inv(P) + np.linalg.inv(R))
    np.testing.assert_allclose(fused.covariance, total, rtol=1e-3, atol=1e-10)
    expected = total @ np.linalg.inv(R) @ step
    np.testing.assert_allclose(difference(fused.pose, prior.pose), expected, rtol=1e-3, atol=1e-7)
    assert_covariance(fused.covariance)


def test_a_match_that_contradicts_the_prediction_stands_alone():
    t = pose_filter()
    prior = t.predict(100 * MS)
    far = Belief(100 * MS, prior.pose @ Pose2(2.0, 0.0, 0.0), SMALL)
    assert t.correct(prior, far, fuse=True) is far
    assert t.belief is far


def test_without_fusion_the_match_stands_alone():
    t = pose_filter()
    prior = t.predict(100 * MS)
    near = Belief(100 * MS, prior.pose @ Pose2(0.001, 0.0, 0.0), SMALL)
    assert t.correct(prior, near, fuse=False) is near


def test_a_miss_carries_the_prediction_and_its_doubt_on():
    t = pose_filter()
    for i in range(1, 40):
        t.miss(t.predict(i * 100 * MS))
    assert t.belief.stamp_ns == 3_900 * MS
    assert t.belief.covariance[0, 0] > 10 * SMALL[0, 0]


def blind(rate, seconds, with_odometry=False):
    """Return the prior after so many seconds of misses at 5 m/s, with odometry or without."""
    t = believing(pose_filter(sigma_xy_per_m=0.02, sigma_xy_per_s=0.05))
    for i in range(round(50 * seconds) + 1) if with_odometry else ():
        assert t.odometry.add(OdometrySample(i * 20 * MS, Pose2(0.1 * i, 0.0, 0.0)))
    for i in range(1, round(rate * seconds) + 1):
        t.miss(t.predict(round(i * 1000 / rate) * MS))
    return t.belief


@pytest.mark.parametrize('with_odometry', [True, False])
def test_what_is_not_known_of_the_motion_does_not_depend_on_the_frame_rate(with_odometry):
    often, seldom = blind(25.0, 8.0, with_odometry), blind(1.0, 8.0, with_odometry)
    np.testing.assert_allclose(often.pose, seldom.pose, atol=1e-9)
    np.testing.assert_allclose(np.diag(often.covariance)[2], np.diag(seldom.covariance)[2])
    grown = math.hypot(0.02 * 40.0, 0.05 * 8.0) if with_odometry else 5.0 * 0.05 * 8.0
    ahead = Pose2(*seldom.pose).rotation().T @ seldom.covariance[:2, :2] @ seldom.pose.rotation()
    assert math.sqrt(ahead[0, 0]) == pytest.approx(grown, rel=0.01)


def test_a_velocity_is_held_for_two_seconds_however_many_frames_miss():
    t = pose_filter()
    for i in range(1, 4):
        fix = Belief(i * 100 * MS, Pose2(1.0 * i, 0.0, 0.0), SMALL)
        t.correct(t.predict(i * 100 * MS), fix, fuse=False)
    for i in range(4, 100):
        t.miss(t.predict(i * 100 * MS))
    assert t.prediction_source == 'standstill'
    assert t.belief.pose.x == pytest.approx(3.0 + 10.0 * 1.9)
    assert t.belief.covariance[0, 0] > 1.0


@pytest.mark.parametrize('speed', [0.5, 1.0, 2.0])
def test_odometry_that_stands_still_is_not_trusted_again_at_a_walk(speed):
    t, rejected = pose_filter(), []
    for i in range(1, 400):
        assert t.odometry.add(OdometrySample(i * 100 * MS, Pose2(0.0, 0.0, 0.0)))
        fix = Belief(i * 100 * MS, Pose2(0.1 * speed * i, 0.0, 0.0), SMALL)
        t.correct(t.predict(i * 100 * MS), fix, fuse=True)
        rejected.append(t.odometry_check.rejected)
    first = rejected.index(True)
    assert first < 80
    assert all(rejected[first:])


BENT = {
    'zero': lambda x: 0.0, 'a tenth': lambda x: 0.1 * x, 'double': lambda x: 2.0 * x,
    'backward': lambda x: -x, 'frozen later': lambda x: min(x, 7.5),
}


@pytest.mark.parametrize('kind', [*BENT, 'right'])
def test_odometry_is_believed_once_it_has_agreed_and_contradicted_at_once(kind):
    t, sources, rejected = pose_filter(), [], []
    for i in range(25):
        reported = BENT.get(kind, float)(0.5 * i)
        assert t.odometry.add(OdometrySample(i * 100 * MS, Pose2(reported, 0.0, 0.0)))
        prior = t.predict(i * 100 * MS)
        sources.append(t.prediction_source)
        t.correct(prior, Belief(i * 100 * MS, Pose2(0.5 * i, 0.0, 0.0), SMALL), fuse=True)
        rejected.append(t.odometry_check.rejected)
    first = sources.index('odometry') if 'odometry' in sources else None
    if kind == 'right':
        assert first == 11
        assert not any(rejected)
        return
    assert first == (11 if kind == 'frozen later' else None)
    assert rejected.index(True) == (17 if kind == 'frozen later' else 1)  # it froze at 15
    assert all(rejected[rejected.index(True):])


def test_a_vehicle_that_stands_proves_no_odometry():
    t = pose_filter()
    for i in range(40):
        assert t.odometry.add(OdometrySample(i * 100 * MS, Pose2(0.0, 0.0, 0.0)))
        stamp = i * 100 * MS
        t.correct(t.predict(stamp), Belief(stamp, Pose2(1.0, 2.0, 0.5), SMALL), fuse=True)
    assert not t.odometry_check.believed
    assert not t.odometry_check.rejected


def test_rejected_odometry_is_believed_again_after_three_agreements():
    t, believed = pose_filter(), []
    for i in range(60):
        reported = 0.0 if i < 5 else 0.5 * (i - 5)
        assert t.odometry.add(OdometrySample(i * 100 * MS, Pose2(reported, 0.0, 0.0)))
        stamp = i * 100 * MS
        t.correct(t.predict(stamp), Belief(stamp, Pose2(0.5 * i, 0.0, 0.0), SMALL), fuse=True)
        believed.append(t.odometry_check.believed)
    assert 5 + 30 <= believed.index(True) <= 5 + 32
    assert not t.odometry_check.rejected


def test_odometry_that_no_fix_has_confirmed_is_one_more_place_to_look_at():
    t = pose_filter()
    for i in range(11):
        assert t.odometry.add(OdometrySample(i * 100 * MS, Pose2(0.5 * i, 0.0, 0.0)))
        t.miss(t.predict(i * 100 * MS))
    assert t.belief.pose == pytest.approx((1.0, 2.0, 0.5))
    unproven = t.predict_unproven(1000 * MS)
    assert unproven.pose == pytest.approx(tuple(Pose2(1.0, 2.0, 0.5) @ Pose2(5.0, 0.0, 0.0)))
    assert np.linalg.eigvalsh(unproven.covariance - t.belief.covariance * 0.99)[0] > 0.0
    assert believing(t).predict_unproven(1000 * MS) is None


def test_a_place_is_followed_as_far_as_a_vehicle_can_go():
    t = pose_filter(max_speed=20.0)
    start = Belief(0, Pose2(0.0, 0.0, 0.0), SMALL)
    t.begin(start)
    prior = t.predict(100 * MS)  # nothing is known of the motion
    assert t.follows(prior, Belief(100 * MS, Pose2(1.9, 0.0, 0.0), SMALL))
    assert not t.follows(prior, Belief(100 * MS, Pose2(2.5, 0.0, 0.0), SMALL))
    t.correct(prior, Belief(100 * MS, Pose2(1.0, 0.0, 0.0), SMALL), fuse=False)
    prior = t.predict(200 * MS)  # 10 m/s, as from one fix to the next
    assert prior.pose.x == pytest.approx(2.0)
    assert t.follows(prior, Belief(200 * MS, Pose2(2.1, 0.0, 0.0), SMALL))
    assert not t.follows(prior, Belief(200 * MS, Pose2(1.0, 0.0, 0.0), SMALL))
    assert not t.follows(prior, Belief(200 * MS, Pose2(2.0, 0.0, 1.0), SMALL))


def test_a_reset_forgets_the_velocity():
    t = pose_filter()
    for i in range(1, 4):
        fix = Belief(i * 100 * MS, Pose2(0.5 * i, 0.0, 0.0), SMALL)
        t.correct(t.predict(i * 100 * MS), fix, fuse=False)
    t.reset(Belief(300 * MS, Pose2(0.0, 0.0, 0.0), SMALL))
    assert t.predict(400 * MS).pose == pytest.approx((0.0, 0.0, 0.0))
    assert t.prediction_source == 'standstill'


BAD = {
    'zero': np.zeros((3, 3)),
    'negative': np.diag([-1.0, 1.0, 1.0]),
    'one zero': np.diag([1.0, 1.0, 0.0]),
    'indefinite': np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    'nan': np.diag([1.0, math.nan, 1.0]),
    'infinite': np.diag([1.0, math.inf, 1.0]),
    'shape': np.eye(2),
}


@pytest.mark.parametrize('fault', BAD)
def test_a_covariance_that_is_none_is_refused(fault):
    with pytest.raises(PriorError):
        checked_prior(0, Pose2(0.0, 0.0, 0.0), BAD[fault])


def test_a_prior_that_is_nowhere_is_refused():
    with pytest.raises(PriorError, match='NaN'):
        checked_prior(0, Pose2(0.0, math.nan, 0.0), np.eye(3))


def test_a_good_prior_is_wrapped_and_made_symmetric():
    skewed = np.array([[1.0, 0.2, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    belief = checked_prior(5, Pose2(1.0, 2.0, 7.0), skewed)
    assert belief.pose.yaw == pytest.approx(7.0 - 2 * math.pi)
    assert belief.covariance[0, 1] == belief.covariance[1, 0] == pytest.approx(0.1)
    assert belief.stamp_ns == 5


@pytest.mark.parametrize('variances', [
    (1e-300, 0.01, 1e-4), (0.01, 1e-300, 1e-300), (1e-300, 1e11, 1e-4), (1e11, 1e11, 1e11),
])
@pytest.mark.parametrize('yaw', [0.0, 0.7])
def test_priors_sharp_or_vague_beyond_reason_can_still_be_reckoned_with(variances, yaw):
    belief = checked_prior(0, Pose2(1.0, 2.0, yaw), np.diag(variances))
    turn = np.eye(3)
    turn[:2, :2] = belief.pose.rotation()
    turned = turn @ belief.covariance @ turn.T
    assert np.isfinite(np.linalg.inv(turned)).all()
    assert np.linalg.eigvalsh(turned)[0] > 0.0
    assert np.all(np.diag(belief.covariance) >= variances)


def test_a_prior_that_says_nothing_is_refused():
    with pytest.raises(PriorError, match='too large to be of use'):
        checked_prior(0, Pose2(1.0, 2.0, 0.0), np.full((3, 3), 1e308))
