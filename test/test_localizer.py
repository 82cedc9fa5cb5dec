# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import math

from camera_samples import HELD, make_camera, SMALL_CAMERA
import numpy as np
import pytest
from road_samples import PARAMETERS, Road
from scipy.stats import chi2

from gip_localizer.core.belief import PriorError
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.parameters import Parameters

MS = 1_000_000
S = 1000 * MS
SMALL = {
    'birdseye.near': 3.0, 'birdseye.far': 9.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.1, 'search.x': 0.4, 'search.y': 0.4, 'search.yaw': 0.03,
    'recovery.automatic': False, 'recovery.cell': 0.4, 'recovery.yaw_step': 0.05,
}
VAGUE = np.diag([0.3**2, 0.3**2, 0.03**2])
CERTAIN = np.diag([0.1**2, 0.1**2, 0.01**2])
CAMERA = make_camera('plumb_bob', **SMALL_CAMERA)
SHAPE = CAMERA.height, CAMERA.width
SPEED = 5.0


def make(road: Road, **more: object) -> Localizer:
    dotted = {name.replace('__', '.'): value for name, value in more.items()}
    return Localizer(road.map, Parameters.from_dict({**SMALL, **dotted}))


def check(estimate: Estimate, truth: Pose2 | None = None, *, xy: float = 0.05,
          yaw: float = 0.005) -> None:
    """No estimate holds NaN; a published one is right, and says how sure it is."""
    assert all(math.isfinite(v) for v in estimate.quality.values()), estimate.quality
    assert estimate.reason
    if estimate.status is not Status.TRACKING:
        assert estimate.pose is None
        assert estimate.covariance is None
        assert not estimate.published
        return
    assert estimate.published
    assert estimate.pose.is_finite()
    assert np.linalg.eigvalsh(estimate.covariance)[0] > 0.0
    np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
    if truth is not None:
        d = difference(estimate.pose, truth)
        assert math.hypot(d[0], d[1]) < xy, d
        assert abs(d[2]) < yaw, d


def drive(road: Road, localizer: Localizer, frames: int, *, start: float = 0.1,
          stamp_ns: int = S, period_ns: int = 100 * MS) -> list[Estimate]:
    """Frames along the lane at SPEED, each checked; what came of them."""
    estimates = []
    for i in range(frames):
        pose = road.pose(start + i * SPEED * period_ns * 1e-9 / road.lane.length)
        image = road.frame(CAMERA, pose, seed=i)
        estimate = localizer.update(stamp_ns + i * period_ns, image, CAMERA)
        check(estimate, pose)
        estimates.append(estimate)
    return estimates


@pytest.mark.parametrize('first_ns', [0, -5 * S])
def test_time_may_begin_anywhere(road, first_ns):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), VAGUE)
    for i in range(4):
        driven = road.pose(0.1 + 0.1 * i * SPEED / road.lane.length)
        moved = road.pose(0.1).inverse() @ driven
        localizer.add_odometry(OdometrySample(first_ns + i * 100 * MS, moved, SPEED))
    found = drive(road, localizer, 4, stamp_ns=first_ns)
    assert all(estimate.published for estimate in found)


@pytest.fixture(scope='module')
def frame(road):
    pose = road.pose(0.1)
    return pose, road.frame(CAMERA, pose)


def test_nothing_is_published_before_a_prior(road, frame):
    localizer = make(road)
    for stamp in range(1, 4):
        estimate = localizer.update(stamp * S, frame[1], CAMERA)
        check(estimate)
        assert estimate.status is Status.NO_PRIOR
        assert 'initialpose' in estimate.reason


def test_a_prior_from_outside_starts_it_and_the_stamp_is_the_image_s(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0] @ Pose2(0.2, -0.1, 0.01), CERTAIN)
    estimate = localizer.update(7 * S + 123, frame[1], CAMERA)
    check(estimate, frame[0])
    assert estimate.status is Status.TRACKING
    assert estimate.stamp_ns == 7 * S + 123
    assert set(estimate.timings_ms) >= {'birdseye', 'gramian', 'match', 'posterior'}


def test_a_prior_from_the_parameters_starts_it(road, frame):
    pose = frame[0]
    localizer = make(road, initial_pose__set=True, initial_pose__x=pose.x + 0.1,
                     initial_pose__y=pose.y, initial_pose__yaw=pose.yaw)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate, pose)
    assert estimate.published


def test_a_drive_is_followed_without_odometry_at_constant_velocity(road):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), CERTAIN)
    estimates = drive(road, localizer, 8, period_ns=60 * MS)
    assert [e.status for e in estimates] == [Status.TRACKING] * 8
    assert localizer.state.pose_filter.prediction_source == 'constant velocity'


def test_odometry_carries_over_a_gap_that_velocity_could_not(road, frame):
    # The vehicle reverses 2 m in the gap: only odometry knows. No fix has confirmed it yet, so
    # that the place it leads to is searched in addition to the last one.
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    assert localizer.update(S, frame[1], CAMERA).published
    for i in range(51):
        sample = OdometrySample(S + i * 20 * MS, Pose2(-0.04 * i, 0.0, 0.0), -2.0)
        assert localizer.add_odometry(sample)
    there = frame[0] @ Pose2(-2.0, 0.0, 0.0)
    estimate = localizer.update(2 * S, road.frame(CAMERA, there), CAMERA)
    check(estimate, there)
    assert estimate.published
    assert localizer.state.pose_filter.prediction_source == 'standstill'


@pytest.mark.parametrize('level', [0, 77, 255])
def test_flat_frames_have_too_little_contrast(road, frame, level):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    estimate = localizer.update(S, np.full(SHAPE, level, np.uint8), CAMERA)
    check(estimate)
    assert estimate.status is Status.LOW_CONTRAST
    assert 'min_contrast' in estimate.reason
    recovered = localizer.update(S + 50 * MS, frame[1], CAMERA)
    check(recovered, frame[0])
    assert recovered.published


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_noise_alone_is_never_published(road, frame, dtype):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    rng = np.random.default_rng(8)
    for i in range(5):
        noise = rng.integers(0, np.iinfo(dtype).max + 1, SHAPE, dtype)
        estimate = localizer.update(S + i * 50 * MS, noise, CAMERA)
        check(estimate)
        assert not estimate.published


def test_a_picture_of_another_place_is_not_published(road, frame):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.6), CERTAIN)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate)
    assert not estimate.published


def test_a_view_beyond_the_map_s_edge_is_off_the_map(road, frame):
    localizer = make(road)
    localizer.set_prior(0, Pose2(4000.0, 0.0, 0.0), CERTAIN)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate)
    assert estimate.status is Status.OFF_MAP


def test_too_little_of_the_view_on_the_map_is_said(road, frame):
    cut = RasterMap(road.map.grey, road.map.resolution, road.map.origin,
                    np.zeros(road.map.grey.shape, bool))
    localizer = Localizer(cut, Parameters.from_dict(SMALL))
    localizer.set_prior(0, frame[0], CERTAIN)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate)
    assert estimate.status is Status.LOW_OVERLAP
    assert 'min_overlap' in estimate.reason


def test_pictures_of_other_places_are_not_published(road):
    localizer = Localizer(road.map, PARAMETERS.replace({'recovery.automatic': False}))
    confused = []
    for i, (here, believed) in enumerate([(0.215, 0.841), (0.151, 0.635), (0.077, 0.567),
                                          (0.295, 0.108), (0.124, 0.835), (0.836, 0.139)]):
        localizer.set_prior(0, road.pose(believed), VAGUE)
        image = road.frame(CAMERA, road.pose(here), seed=i)
        estimate = localizer.update((i + 1) * S, image, CAMERA)
        check(estimate)
        if estimate.published:
            confused.append((here, believed, estimate.reason, estimate.quality['agreement']))
    assert not confused


def test_a_flat_map_is_not_matched(road, frame):
    grey = np.full_like(road.map.grey, 0.4)
    localizer = Localizer(replace(road.map, grey=grey), Parameters.from_dict(SMALL))
    localizer.set_prior(0, frame[0], CERTAIN)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate)
    assert not estimate.published


def test_a_map_that_repeats_itself_is_ambiguous():
    # Stripes across the road, alike every 0.2 m: they cannot be distinguished.
    stripes = np.where(np.arange(400) // 2 % 2 == 0, 0.2, 0.8).astype(np.float32)
    raster_map = RasterMap(np.tile(stripes, (400, 1)), 0.05, Pose2(0.0, -10.0, 0.0))
    pose = Pose2(3.0, 0.0, 0.0)
    camera = make_camera(held=Extrinsics(z=1.5, pitch=0.5))
    u, v = np.meshgrid(np.arange(640), np.arange(360))
    xy, on_road = camera.road_points(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    grey, _ = raster_map.sample(pose.transform(np.where(on_road[:, None], xy, 0.0)))
    image = (255 * grey.reshape(360, 640)).astype(np.uint8)
    localizer = Localizer(raster_map, Parameters.from_dict({
        **SMALL, 'birdseye.near': 2.0, 'birdseye.far': 5.0, 'birdseye.half_width': 1.0,
        'birdseye.resolution': 0.05,
    }))
    localizer.set_prior(0, pose, np.diag([1.0, 0.01, 1e-4]))
    estimate = localizer.update(S, image, camera)
    check(estimate)
    assert estimate.status in (Status.AMBIGUOUS, Status.UNCERTAIN, Status.NO_MATCH)


def test_frames_out_of_order_are_skipped_and_harm_nothing(road):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), CERTAIN)
    drive(road, localizer, 3, period_ns=60 * MS)
    belief = localizer.state.pose_filter.belief
    image = road.frame(CAMERA, road.pose(0.1))
    for back in (0, 1, 60 * MS, 900 * MS):
        estimate = localizer.update(S + 120 * MS - back, image, CAMERA)
        check(estimate)
        assert estimate.status is Status.OUT_OF_ORDER
    assert localizer.state.pose_filter.belief is belief


def test_time_that_jumps_back_starts_afresh(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    assert localizer.update(1000 * S, frame[1], CAMERA).published
    assert localizer.update(4 * S, frame[1], CAMERA).status is Status.OUT_OF_ORDER
    estimate = localizer.update(5 * S, frame[1], CAMERA)
    check(estimate)
    assert estimate.status is Status.NO_PRIOR
    localizer.set_prior(0, frame[0], CERTAIN)
    again = localizer.update(6 * S, frame[1], CAMERA)
    check(again, frame[0])
    assert again.published


def test_time_that_jumps_back_returns_to_the_initial_pose_of_the_parameters(road, frame):
    pose = frame[0]
    localizer = make(road, initial_pose__set=True, initial_pose__x=pose.x,
                     initial_pose__y=pose.y, initial_pose__yaw=pose.yaw)
    assert localizer.update(1000 * S, frame[1], CAMERA).published
    assert localizer.update(4 * S, frame[1], CAMERA).status is Status.OUT_OF_ORDER
    again = localizer.update(5 * S, frame[1], CAMERA)
    check(again, pose)
    assert again.published


@pytest.mark.parametrize(('ahead_ms', 'count'), [
    (600, 1), (3_000, 1), (30_000, 1), (3_600_000, 2),
])
def test_a_stamp_ahead_of_its_time_harms_no_later_frame(road, ahead_ms, count):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), CERTAIN)
    stamp, step = 1000 * S, 100 * MS
    for i in range(4):
        image = road.frame(CAMERA, road.pose(0.1 + 0.1 * i * SPEED / road.lane.length))
        localizer.update(stamp + i * step, image, CAMERA)
    for i in range(4, 4 + count):
        image = road.frame(CAMERA, road.pose(0.1 + 0.1 * i * SPEED / road.lane.length))
        localizer.update(stamp + i * step + ahead_ms * MS, image, CAMERA)
    start = 0.1 + 0.1 * (4 + count) * SPEED / road.lane.length
    later = drive(road, localizer, 4, start=start, stamp_ns=stamp + (4 + count) * step)
    assert all(estimate.published for estimate in later)
    assert localizer.state.stamps.went_back == 0.0


def test_a_prior_of_another_clock_holds_now(road, frame):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.4), CERTAIN)
    localizer.update(3600 * S, frame[1], CAMERA)
    localizer.set_prior(7 * S, frame[0], CERTAIN)
    assert localizer.update(3600 * S + 100 * MS, frame[1], CAMERA).published


@pytest.mark.parametrize(('change', 'words'), [
    (lambda image: image[::2, ::2], 'shape (90, 160)'),
    (lambda image: np.dstack([image] * 3), 'shape (180, 320, 3)'),
    (lambda image: np.full(image.shape, np.nan, np.float32), 'NaN'),
])
def test_an_image_that_is_none_of_the_camera_is_told_and_harms_nothing(road, frame, change, words):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    estimate = localizer.update(S, change(frame[1]), CAMERA)
    assert estimate.status is Status.BAD_IMAGE
    assert words in estimate.reason
    estimate = localizer.update(S, frame[1], CAMERA, mask=np.ones((10, 10), np.uint8))
    assert 'the mask has shape (10, 10)' in estimate.reason
    seen = np.ones(frame[1].shape, bool)
    assert localizer.update(S, frame[1], CAMERA, mask=seen).published


@pytest.mark.parametrize('sigma', [0.02, 0.05])
def test_a_map_that_tells_its_noise_is_known_all_the_same(road, frame, sigma):
    noise = np.full(road.map.grey.shape, sigma, np.float32)
    off = np.random.default_rng(1).normal(0.0, sigma, noise.shape).astype(np.float32)
    grey = np.clip(on_unit_scale(road.map.grey) + off, 0.0, 1.0)
    noisy = replace(road.map, grey=grey, noise=noise)
    localizer = Localizer(noisy, make(road).parameters)
    localizer.set_prior(0, frame[0], CERTAIN)
    estimate = localizer.update(S, frame[1], CAMERA)
    check(estimate, frame[0])
    assert estimate.published
    assert estimate.match.fit.overlap == pytest.approx(1.0, abs=0.01)


def test_a_dim_night_is_no_flat_frame(road):
    """The gain is unknown at first; with the gain of a bright day the map would be noise."""
    localizer, pose = make(road), road.pose(0.1)
    bright = road.frame(CAMERA, pose).astype(float)
    rng = np.random.default_rng(3)
    dim = 0.03 * bright + 6.0 + rng.normal(0.0, 0.7, bright.shape)
    image = np.clip(np.round(dim), 0, 255).astype(np.uint8)
    localizer.set_prior(0, pose @ Pose2(0.1, -0.1, 0.01), CERTAIN)
    estimate = localizer.update(S, image, CAMERA)
    check(estimate, pose)
    assert estimate.published


@pytest.mark.parametrize('period', [0.9, 1.2])
def test_equal_places_in_the_window_stay_rivals_of_one_beyond_it(period):
    """The best of the equal places may lie a few centimetres outside the window."""
    repeated = Road(period)
    localizer, pose = make(repeated), repeated.pose(0.1)
    rng, image = np.random.default_rng(5), repeated.frame(CAMERA, repeated.pose(0.1))
    for i in range(12):
        start = pose @ Pose2(*(rng.uniform(-1.0, 1.0, 3) * [0.5, 0.5, 0.03]).tolist())
        localizer.set_prior(0, start, VAGUE)
        estimate = localizer.update((i + 1) * S, image, CAMERA)
        check(estimate, pose)


def test_a_mask_over_all_of_the_view_is_told(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    black = np.zeros((CAMERA.height, CAMERA.width), np.uint8)
    estimate = localizer.update(S, frame[1], CAMERA, mask=black)
    assert estimate.status is Status.LOW_CONTRAST
    assert 'mask' in estimate.reason


@pytest.mark.parametrize('wrong', [-1000, 0, 900, 1100, 5_700_000])  # s; the drive is at 1000
def test_a_single_stamp_that_is_far_off_costs_one_frame_and_no_belief(road, wrong):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), CERTAIN)
    drive(road, localizer, 3, stamp_ns=1000 * S, period_ns=60 * MS)
    belief = localizer.state.pose_filter.belief
    image = road.frame(CAMERA, road.pose(0.1))
    for _ in range(2):
        estimate = localizer.update(wrong * S, image, CAMERA)
        check(estimate)
        assert estimate.status is Status.OUT_OF_ORDER
        assert f' {abs(wrong - 1000.12):.1f} s ' in estimate.reason
    assert localizer.state.pose_filter.belief is belief
    start = 0.1 + 0.18 * SPEED / road.lane.length
    later = drive(road, localizer, 2, start=start, stamp_ns=1000 * S + 180 * MS, period_ns=60 * MS)
    assert all(estimate.published for estimate in later)


def test_a_pause_of_minutes_is_over_with_the_second_frame_after_it(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    assert localizer.update(S, frame[1], CAMERA).published
    assert localizer.update(600 * S, frame[1], CAMERA).status is Status.OUT_OF_ORDER
    assert localizer.update(601 * S, frame[1], CAMERA).published


def test_a_vehicle_that_drives_on_while_the_map_is_searched_is_found(road):
    """A search takes a second, after which the place is no longer where the vehicle is."""
    localizer, statuses, passed = make(road), [], 0.0
    localizer.relocalize()
    while passed < 6.0:
        stamp, pose = S + round(passed * S), road.pose(0.05 + 3.0 * passed / road.lane.length)
        passed += 1.3 if localizer.searches(stamp) else 0.1
        estimate = localizer.update(stamp, road.frame(CAMERA, pose), CAMERA)
        check(estimate, pose)
        statuses.append(estimate.status)
    assert statuses[:2] == [Status.CONFIRMING, Status.LOST]  # two places that give a velocity
    assert statuses[-20:] == [Status.TRACKING] * 20


@pytest.mark.parametrize('speed', [5.0, 40.0])
def test_frames_confirm_a_found_place_only_where_the_vehicle_can_be(road, speed):
    """Each match is believed by itself; a vehicle of 20 m/s cannot have made the second way."""
    localizer = make(road, recovery__confirm_frames=2, motion__max_speed=20.0)
    localizer.relocalize()
    statuses = []
    for i in range(2):
        pose = road.pose(0.1 + i * 5e-3 * speed / road.lane.length)
        image = road.frame(CAMERA, pose)
        statuses.append(localizer.update(S + i * 5 * MS, image, CAMERA).status)
    second = Status.TRACKING if speed < 20.0 else Status.CONFIRMING
    assert statuses == [Status.CONFIRMING, second]


def test_lost_after_enough_misses_and_silent_until_found(road, frame):
    localizer = make(road, integrity__lost_after=3)
    localizer.set_prior(0, frame[0], CERTAIN)
    black = np.zeros(SHAPE, np.uint8)
    statuses = []
    for i in range(5):
        estimate = localizer.update(S + i * 50 * MS, black, CAMERA)
        check(estimate)
        statuses.append(estimate.status)
    assert statuses == [Status.LOW_CONTRAST] * 2 + [Status.LOST] * 3
    assert localizer.state.lost
    assert 'LOW_CONTRAST' in estimate.reason


def test_relocalize_finds_the_place_without_a_prior_and_confirms_it(road, frame):
    localizer = make(road, recovery__confirm_frames=2)
    assert localizer.update(S, frame[1], CAMERA).status is Status.NO_PRIOR
    localizer.relocalize()
    first = localizer.update(2 * S, frame[1], CAMERA)
    check(first)
    assert first.status is Status.CONFIRMING
    second = localizer.update(2 * S + 50 * MS, frame[1], CAMERA)
    check(second, frame[0])
    assert second.published


def test_a_lost_vehicle_is_found_again_by_itself(road, frame):
    localizer = make(road, recovery__automatic=True, integrity__lost_after=2,
                     recovery__confirm_frames=1, recovery__period=0.1)
    localizer.set_prior(0, road.pose(0.6), CERTAIN)
    found = None
    for i in range(6):
        estimate = localizer.update(S + i * 200 * MS, frame[1], CAMERA)
        check(estimate, frame[0])
        found = found or (i if estimate.published else None)
    assert found is not None
    assert found >= 2  # not before it was lost


def test_relocalizing_on_nothing_stays_silent(road):
    localizer = make(road)
    localizer.relocalize()
    noise = np.random.default_rng(3).integers(0, 256, SHAPE, np.uint8)
    for i, image in enumerate((np.zeros(SHAPE, np.uint8), noise)):
        estimate = localizer.update(S + i * 100 * MS, image, CAMERA)
        check(estimate)
        assert not estimate.published


def test_a_view_across_the_lane_is_found_on_the_whole_map(road):
    on_lane = road.pose(0.6068965517241379)  # places next to it have indefinite information
    pose = Pose2(on_lane.x, on_lane.y, on_lane.yaw + 5.7)
    localizer = make(road, recovery__confirm_frames=1)
    localizer.relocalize()
    estimate = localizer.update(S, road.frame(CAMERA, pose), CAMERA)
    check(estimate, pose)
    assert estimate.status is Status.TRACKING


@pytest.mark.parametrize('pose', [Pose2(math.nan, 0.0, 0.0), Pose2(0.0, 0.0, math.inf)])
def test_a_prior_that_is_none_is_refused_and_the_belief_stays(road, frame, pose):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    before = localizer.state.pose_filter.belief
    with pytest.raises(PriorError):
        localizer.set_prior(0, pose, CERTAIN)
    for bad in (np.zeros((3, 3)), -CERTAIN, CERTAIN * math.nan):
        with pytest.raises(PriorError):
            localizer.set_prior(0, frame[0], bad)
    assert localizer.state.pose_filter.belief is before
    assert localizer.update(S, frame[1], CAMERA).published


@pytest.mark.parametrize('change', [
    {'score.metric': 'gip'}, {'birdseye.resolution': 0.05}, {'birdseye.far': 7.0},
    {'search.x': 0.2, 'search.yaw_step': 0.005}, {'score.robust': False},
    {'camera_motion.sigma_pitch': 0.0, 'camera_motion.sigma_roll': 0.0,
     'camera_motion.sigma_height': 0.0},
])
def test_parameters_change_between_frames_and_the_belief_stays(road, frame, change):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    assert localizer.update(S, frame[1], CAMERA).published
    localizer.configure(localizer.parameters.replace(change))
    estimate = localizer.update(S + 50 * MS, frame[1], CAMERA)
    check(estimate, frame[0])
    assert estimate.published


def test_a_calibration_that_changes_is_taken_at_once(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    assert localizer.update(S, frame[1], CAMERA).published
    other = make_camera('equidistant', size=(320, 180), focal=150.0,
                        held=replace(HELD, z=1.3, yaw=-0.05))
    estimate = localizer.update(S + 50 * MS, road.frame(other, frame[0]), other)
    check(estimate, frame[0])
    assert estimate.published


def test_a_camera_that_sees_no_road_is_told_and_a_good_one_goes_on(road, frame):
    localizer = make(road)
    localizer.set_prior(0, frame[0], CERTAIN)
    sky = make_camera('plumb_bob', held=replace(HELD, pitch=-1.0), **SMALL_CAMERA)
    estimate = localizer.update(S, frame[1], sky)
    check(estimate)
    assert estimate.status is Status.NO_ROAD_IN_VIEW
    good = localizer.update(S + 50 * MS, frame[1], CAMERA)
    check(good, frame[0])
    assert good.published


def test_bad_odometry_costs_no_fix(road):
    localizer = make(road)
    localizer.set_prior(0, road.pose(0.1), CERTAIN)
    bad = [
        OdometrySample(S - 10 * MS, Pose2(0.0, 0.0, 0.0)),
        OdometrySample(S - 20 * MS, Pose2(0.0, 0.0, 0.0)),
        OdometrySample(S, Pose2(math.nan, 0.0, 0.0)),
        OdometrySample(S + 10 * MS, Pose2(900.0, 0.0, 0.0)),
        OdometrySample(0, Pose2(0.0, 0.0, 0.0)),
        OdometrySample(S + 20 * MS, Pose2(900.0, 0.0, 0.0), math.inf),
    ]
    taken = [localizer.add_odometry(sample) for sample in bad]
    assert taken == [True, False, False, False, False, False]
    assert localizer.state.pose_filter.odometry.refused == 5
    assert all(e.published for e in drive(road, localizer, 3, period_ns=40 * MS))


def test_the_covariance_says_how_large_the_errors_are(road):
    # Single frames, not fused: the mean NEES lies in the band of its chi-square distribution.
    localizer = Localizer(road.map, PARAMETERS.replace({'motion.fuse': False}))
    rng = np.random.default_rng(11)
    nees = []
    for i in range(30):
        truth = road.pose(i / 30) @ Pose2(0.0, rng.uniform(-0.3, 0.3), rng.uniform(-0.05, 0.05))
        localizer.set_prior(0, truth @ Pose2(*rng.uniform(-1, 1, 3) * [0.2, 0.2, 0.02]), VAGUE)
        estimate = localizer.update((i + 1) * S, road.frame(CAMERA, truth, seed=i), CAMERA)
        check(estimate, truth)
        if estimate.published:
            error = difference(estimate.pose, truth)
            nees.append(error @ np.linalg.solve(estimate.covariance, error))
    assert len(nees) >= 28
    low, high = chi2.ppf([0.001, 0.999], 3 * len(nees)) / len(nees)
    assert 0.5 * low < np.mean(nees) < high  # some caution is no fault


def test_the_same_frames_give_the_same_estimates(road, frame):
    outcomes = []
    for _ in range(2):
        localizer = make(road)
        localizer.set_prior(0, frame[0] @ Pose2(0.1, 0.1, 0.01), CERTAIN)
        outcomes.append(localizer.update(S, frame[1], CAMERA))
    assert outcomes[0].pose == outcomes[1].pose
    np.testing.assert_array_equal(outcomes[0].covariance, outcomes[1].covariance)
