# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The file of the last pose: whole or absent, never of another map, frame or day."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.parameters import Motion, Parameters
from gip_localizer.session.pose_file import LastPose, load_state, map_hash, save_state, StateError
from gip_localizer.session.pose_restore import StateKeeper

SECOND = 1_000_000_000
HASH = 'a' * 16
COVARIANCE = tuple(float(v) for v in np.diag([0.01, 0.02, 0.001]).ravel())
STATE = LastPose(HASH, 'map', 1000.0, (10.0, 20.0, 0.5), COVARIANCE, 3.0, (1.0, 2.0, 0.1))
EXPECTED = {'expected_hash': HASH, 'frame': 'map', 'max_age': 60.0}


def cells(shift=0):
    grey = np.random.default_rng(1).integers(0, 255, (200, 200)).astype(np.uint8)
    grey[0, 0] += shift
    return RasterMap(grey, 0.1, Pose2(0.0, 0.0, 0.0))


def test_what_is_written_is_read_back(tmp_path):
    path = tmp_path / 'state.json'
    save_state(path, STATE)
    loaded = load_state(path, now=1010.0, **EXPECTED)
    assert (loaded.pose, loaded.odometry) == (list(STATE.pose), list(STATE.odometry))
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(('changes', 'now', 'words'), [
    ({'expected_hash': 'b' * 16}, 1010.0, 'another map'),
    ({'frame': 'city'}, 1010.0, "in frame 'map'"),
    ({}, 1061.0, 'expected 0 to 60'),
    ({}, 990.0, '-10 s old'),
])  # fmt: skip
def test_a_foreign_or_stale_file_is_refused(tmp_path, changes, now, words):
    path = tmp_path / 'state.json'
    save_state(path, STATE)
    with pytest.raises(StateError, match=words):
        load_state(path, now=now, **{**EXPECTED, **changes})


@pytest.mark.parametrize('text', [
    '', '[]', '{}', '{"format": 1}', 'nonsense', '{"format": 2}', '[' * 5000,
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1.0,
                'pose': [1, 2], 'covariance': [0] * 9}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1.0,
                'pose': [1, 2, 3], 'covariance': [0] * 9}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1.0,
                'pose': [1, 2, math.nan], 'covariance': COVARIANCE}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1.0,
                'pose': {'x': 1}, 'covariance': COVARIANCE}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': '1000.0',
                'pose': [1, 2, 3], 'covariance': COVARIANCE}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 10**400,
                'pose': [1, 2, 3], 'covariance': COVARIANCE}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1000.0, 'speed': '3',
                'pose': [1, 2, 3], 'covariance': COVARIANCE}),
    json.dumps({'format': 1, 'map_hash': HASH, 'frame': 'map', 'saved_at': 1000.0,
                'odometry': ['1', '2', '3'], 'pose': [1, 2, 3], 'covariance': COVARIANCE}),
])  # fmt: skip
def test_a_damaged_file_is_refused_with_its_name(tmp_path, text):
    path = tmp_path / 'state.json'
    path.write_text(text)
    with pytest.raises(StateError, match=r'state\.json'):
        load_state(path, now=1010.0, **EXPECTED)


def test_a_folder_that_is_not_there_is_an_error_that_names_it(tmp_path):
    with pytest.raises(StateError, match='missing'):
        save_state(tmp_path / 'missing' / 'state.json', STATE)


def test_the_hash_tells_maps_apart():
    same, other = map_hash(cells()), map_hash(cells(shift=1))
    assert same == map_hash(cells())
    assert same != other
    moved = RasterMap(cells().grey, 0.1, Pose2(0.0, 0.0, 0.01))
    assert map_hash(moved) != same


def test_the_prior_moves_by_the_odometry_since_and_grows():
    moved = Pose2(1.0, 2.0, 0.1) @ Pose2(5.0, 0.0, 0.0)
    belief = STATE.prior(1002.0, Motion(), moved)
    expected = Pose2(10.0, 20.0, 0.5) @ Pose2(5.0, 0.0, 0.0)
    assert belief.pose == pytest.approx(expected)
    assert 0.1 < math.sqrt(belief.covariance[0, 0]) < 0.6


def test_odometry_that_began_anew_does_not_tighten_the_prior():
    belief = STATE.prior(1001.0, Motion(), Pose2(5000.0, 0.0, 0.0))
    assert math.sqrt(belief.covariance[0, 0]) > 1.0


def test_without_odometry_the_speed_is_held_with_a_wide_prior():
    belief = STATE.prior(1004.0, Motion(), None)
    assert belief.pose == pytest.approx(Pose2(10.0, 20.0, 0.5) @ Pose2(12.0, 0.0, 0.0))
    assert math.sqrt(belief.covariance[0, 0]) > 6.0


def keeper_of(path, now, reports=None):
    localizer = Localizer(cells(), Parameters.from_dict({'state_file': str(path)}))
    reports = [] if reports is None else reports
    return localizer, StateKeeper(localizer, reports.append, wall=lambda: now)


def test_a_restart_begins_where_the_last_pose_and_the_odometry_lead(tmp_path):
    path = tmp_path / 'state.json'
    localizer, keeper = keeper_of(path, 1000.0)
    localizer.add_odometry(OdometrySample(5 * SECOND, Pose2(1.0, 0.0, 0.0)))
    pose, covariance = Pose2(8.0, 9.0, 0.0), np.diag([1e-4, 1e-4, 1e-6])
    keeper.after(Estimate(5 * SECOND, Status.TRACKING, '', pose, covariance))

    reports = []
    localizer, keeper = keeper_of(path, 1003.0, reports)
    keeper.before(8 * SECOND)
    assert localizer.state.pose_filter.belief is None  # it waits for the odometry
    localizer.add_odometry(OdometrySample(8 * SECOND, Pose2(3.0, 0.0, 0.0)))
    keeper.before(8 * SECOND)
    assert localizer.state.pose_filter.belief.pose == pytest.approx(Pose2(10.0, 9.0, 0.0))
    assert reports == []


def test_a_better_prior_keeps_the_file_out(tmp_path):
    path = tmp_path / 'state.json'
    _, keeper = keeper_of(path, 1000.0)
    keeper.after(Estimate(SECOND, Status.TRACKING, '', Pose2(8.0, 9.0, 0.0), np.eye(3) * 1e-4))
    localizer, keeper = keeper_of(path, 1001.0)
    keeper.forget()
    keeper.before(2 * SECOND)
    assert localizer.state.pose_filter.belief is None


def test_nothing_is_written_without_a_pose_or_a_file_name(tmp_path):
    path = tmp_path / 'state.json'
    _, keeper = keeper_of(path, 1000.0)
    keeper.after(Estimate(SECOND, Status.LOST, 'lost'))
    _, off = keeper_of('', 1000.0)
    off.after(Estimate(SECOND, Status.TRACKING, '', Pose2(8.0, 9.0, 0.0), np.eye(3)))
    assert list(tmp_path.iterdir()) == []


def test_a_pose_that_may_be_anywhere_by_now_is_told_and_not_used(tmp_path):
    path = tmp_path / 'state.json'
    save_state(path, LastPose(map_hash(cells()), 'map', 0.0, STATE.pose, STATE.covariance, 40.0))
    values = {'state_file': str(path), 'state.max_age': 1e6}
    localizer = Localizer(cells(), Parameters.from_dict(values))
    reports = []
    StateKeeper(localizer, reports.append, wall=lambda: 9e5).before(SECOND)
    assert localizer.state.pose_filter.belief is None
    assert 'too large to be of use' in reports[0]
    assert 'not used' in reports[0]


def test_a_name_that_no_file_can_have_is_told(tmp_path):
    reports = []
    _, keeper = keeper_of(tmp_path / ('x' * 300), 1000.0, reports)
    keeper.after(Estimate(SECOND, Status.TRACKING, '', Pose2(8.0, 9.0, 0.0), np.eye(3) * 1e-4))
    assert 'cannot be written' in reports[0]


def test_a_stale_file_is_told_and_not_used(tmp_path):
    path = tmp_path / 'state.json'
    _, keeper = keeper_of(path, 1000.0)
    keeper.after(Estimate(SECOND, Status.TRACKING, '', Pose2(8.0, 9.0, 0.0), np.eye(3) * 1e-4))
    reports = []
    localizer, keeper = keeper_of(path, 2000.0, reports)
    keeper.before(2 * SECOND)
    assert localizer.state.pose_filter.belief is None
    assert 'state.max_age' in reports[0]


def test_a_parked_vehicle_writes_four_times_in_the_age_that_a_file_may_have(tmp_path):
    path, clock = tmp_path / 'state.json', [1000.0]
    localizer = Localizer(cells(), Parameters.from_dict({'state_file': str(path)}))
    keeper, written = StateKeeper(localizer, pytest.fail, wall=lambda: clock[0]), set()
    for second in range(60):
        clock[0] = 1000.0 + second
        pose = Pose2(8.0, 9.0 + 1e-3 * (second % 2), 0.0)
        keeper.after(Estimate(second * SECOND, Status.TRACKING, '', pose, np.eye(3) * 1e-4))
        written.add(path.read_bytes())
    assert len(written) == 4
    clock[0] += 1.0
    keeper.after(Estimate(60 * SECOND, Status.TRACKING, '', Pose2(9.0, 9.0, 0.0), np.eye(3)))
    assert path.read_bytes() not in written
