# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip evaluate`: what is tried, how it is judged, what is written."""

import csv
from dataclasses import replace
import json
import math

import numpy as np
import pytest
from scipy.stats import chi2

from gip_localizer.cli import main
from gip_localizer.core.localizer import Localizer
from gip_localizer.evaluation.suites.conditions import CLEAR, CONDITIONS, TILES
from gip_localizer.evaluation.suites.cramer_rao import pose_bound, PURE
from gip_localizer.evaluation.suites.grounds import (
    ASPHALT,
    lane,
    LINE,
    noisy_map,
    PERIOD_M,
    repeated_ground,
)
from gip_localizer.evaluation.suites.integrity import (
    FAR_M,
    IntegritySuite,
    kind_of,
    lost_at,
    REPEATED,
    RIGHT,
    WRONG_KINDS,
    wrong_start,
)
from gip_localizer.evaluation.suites.runner import jobs, run_all, SUITES
from gip_localizer.evaluation.suites.single_frame import (
    condition_bounds,
    LEAST_JUDGED,
    nees_band,
    summary,
)
from gip_localizer.evaluation.suites.suite import Bound, Record
from gip_localizer.evaluation.suites.tables import COLUMNS, format_section
from gip_localizer.evaluation.suites.trials import Bench, is_wrong, Spread, Trial
from gip_localizer.synthetic.worlds import map_of, tiles_world


@pytest.fixture(scope='module')
def bench():
    return Bench(TILES, 3, {})


@pytest.fixture
def small_scenes(monkeypatch):
    """Every condition with a sixteenth of the camera's pixels, over a world quick to make."""
    small = {'world.resolution': 0.05, 'world.join': 1, 'lens.width': 320, 'lens.height': 180,
             'lens.focal': 225.0}
    for condition in CONDITIONS:
        if condition is not TILES:  # small as it is
            for name, value in small.items():
                monkeypatch.setitem(condition.camera, name, value)


def published(ahead, sigma=0.01):
    error = np.array([ahead, 0.0, 0.0])
    covariance = np.diag([sigma**2, sigma**2, 1e-6])
    return Trial('TRACKING', error, error, covariance, covariance, {'confidence': 0.9})


@pytest.mark.parametrize(('value', 'at_most', 'met'), [
    (1.0, True, True), (1.1, True, False), (1.0, False, True), (0.9, False, False),
    (math.nan, True, False), (math.nan, False, False),
])
def test_a_bound_is_met_on_its_side_and_never_by_nothing(value, at_most, met):
    assert Bound('row', 'what', value, 1.0, at_most).met is met


def test_summary_of_known_errors():
    found = summary([published(0.03), published(-0.04), Trial('NO_MATCH')])
    assert (found.frames, found.published, found.wrong) == (3, 2, 0)
    assert found.rmse_xy == pytest.approx(math.sqrt((0.03**2 + 0.04**2) / 2))
    assert found.nees == pytest.approx((9 + 16) / 2)
    assert found.sigma_xy == pytest.approx(0.01 * math.sqrt(2))


def test_the_band_of_nees_narrows_to_its_freedom():
    low, high = nees_band(50)
    assert chi2.cdf(high * 50, 150) - chi2.cdf(low * 50, 150) == pytest.approx(0.95)
    assert low < 3.0 < high
    assert all(math.isnan(edge) for edge in nees_band(0))


@pytest.mark.parametrize(('count', 'judged'), [(4, False), (LEAST_JUDGED, True)])
def test_the_nees_of_few_frames_is_no_bound(count, judged):
    demands = condition_bounds(CLEAR, summary([published(0.05)] * count))
    assert ('mean NEES' in {bound.what for bound in demands if not bound.met}) is judged


def test_silence_and_wrong_poses_miss_bounds():
    silent = condition_bounds(CLEAR, summary([Trial('NO_MATCH')]))
    assert not any(bound.met for bound in silent if 'wrong' not in bound.what)
    wrong = condition_bounds(CLEAR, summary([published(0.7)]))
    assert 'wrong poses published' in {bound.what for bound in wrong if not bound.met}


def test_half_of_the_starts_are_right_and_each_kind_of_wrong_occurs():
    kinds = [kind_of('clear', index) for index in range(16)]
    assert kinds.count(RIGHT) == 8
    assert {kind: kinds.count(kind) for kind in WRONG_KINDS} == dict.fromkeys(WRONG_KINDS, 2)
    assert kind_of(REPEATED.name, 0) == 'repeated'


@pytest.mark.parametrize('kind', [RIGHT, *WRONG_KINDS])
def test_starts_are_where_their_kind_says(bench, kind):
    rng = np.random.default_rng(5)
    for place in range(20):
        truth = bench.drive.truth(place * 37)
        start = wrong_start(kind, truth, bench, rng)
        apart = math.hypot(start.x - truth.x, start.y - truth.y)
        inside = bench.raster_map.contains(np.array([[start.x, start.y]]))[0]
        if kind == RIGHT:
            assert apart < 0.75
        else:
            assert apart > 1.4
        assert inside != (kind == 'off the map')
        assert kind != 'another street' or apart > FAR_M


def test_separation_counts_right_matches_below_the_wrong():
    def record(kind, ahead, confidence):
        error = np.array([ahead, 0.0, 0.0])
        trial = Trial('NO_MATCH', None, error, quality={'confidence': confidence})
        return Record('integrity', 'clear', 0, kind, trial)

    wrong = [record('off the map', 3.0, c) for c in np.linspace(0.0, 0.5, 21)]
    right = [record(RIGHT, 0.0, c) for c in (0.2, 0.9, 0.9, 0.9)]
    assert lost_at(right + wrong, 0.95) == pytest.approx(0.25)


def test_repeated_ground_is_the_same_a_period_on_and_a_lane_all_along():
    world = tiles_world(seed=1, size=(12.0, 9.0), resolution=0.025)
    cells = round(PERIOD_M / 0.025)
    grey = repeated_ground(world).raster.grey
    np.testing.assert_array_equal(grey[:, cells:], grey[:, :-cells])
    np.testing.assert_array_equal(grey[cells:], grey[:-cells])
    assert grey.std() > 0.1
    bare = lane(world).raster.grey
    np.testing.assert_array_equal(bare, np.broadcast_to(bare[:, :1], bare.shape))
    assert set(np.unique(bare)) == {np.float32(ASPHALT), np.float32(LINE)}


def test_a_noisy_map_is_off_by_about_what_is_asked():
    raster = map_of(tiles_world(seed=1, size=(12.0, 9.0), resolution=0.025).raster, 2)
    off = noisy_map(raster, 0.05, seed=2).grey - raster.grey
    assert off.std() == pytest.approx(0.05, rel=0.1)
    assert abs(off.mean()) < 0.005


def test_the_bound_grows_with_the_noise_and_a_tracked_frame_respects_it(bench):
    def bound(noise):
        camera = {**TILES.camera, **PURE, 'sensor.read_noise': noise}
        own = Bench(replace(TILES, camera=camera), 3, {})
        return pose_bound(own, own.drive.truth(100))

    small, large = bound(0.05), bound(0.1)
    np.testing.assert_allclose(large, 4.0 * small, rtol=1e-6)
    assert np.all(np.linalg.eigvalsh(small) > 0.0)
    assert 1e-5 < math.sqrt(small[0, 0]) < 1e-3


def test_jobs_hold_every_trial_once():
    work = jobs(tuple(SUITES), frames=23, seed=1, overrides={})
    tried = [(j.suite, j.part, k) for j in work for k in range(j.first, j.first + j.count)]
    assert len(tried) == len(set(tried))
    assert {(s, p) for s, p, _ in tried} == {
        (name, part) for name, suite in SUITES.items() for part in suite.setups
    }
    assert sum(1 for t in tried if t[:2] == ('conditions', 'clear')) == 23


def test_records_do_not_depend_on_processes_nor_on_what_was_tried_before():
    work = [job for job in jobs(('conditions',), frames=12, seed=4, overrides={})
            if job.part == 'tiles']
    finished = []
    both = run_all(work, processes=2, done=finished.append)
    assert {job.first for job in finished} == {0, 10}
    later = run_all(work[1:], processes=1, done=finished.append)
    for one, other in zip(both[10:], later, strict=True):
        assert (one.part, one.index, one.trial.status) == (
            other.part, other.index, other.trial.status
        )
        np.testing.assert_array_equal(one.trial.raw_error, other.trial.raw_error)


def test_repeated_ground_is_never_trusted():
    suite = IntegritySuite()
    ground = replace(TILES, name=REPEATED.name, ground='repeated')
    on_tiles = Bench(replace(ground, camera={**TILES.camera, 'world.resolution': 0.025}), 3, {})
    records = [suite.run(on_tiles, REPEATED.name, k)[0] for k in range(6)]
    assert {r.trial.error is None for r in records} == {True}
    assert 'AMBIGUOUS' in {r.trial.status for r in records}


def test_a_start_near_the_truth_is_found_and_one_elsewhere_is_not_believed(bench):
    near = bench.trial(0, Spread())
    assert near.error is not None
    assert not is_wrong(near.error)
    away = [IntegritySuite().run(bench, 'tiles', k)[0].trial for k in (1, 3, 5, 7)]
    assert not any(trial.wrong for trial in away)


@pytest.mark.usefixtures('small_scenes')
def test_the_command_writes_what_it_found_and_fails_on_a_missed_bound_or_a_trial_that_raises(
    tmp_path, capsys, monkeypatch
):
    update, calls = Localizer.update, iter(range(100))

    def sometimes(*args, **options):
        return 1 / 0 if next(calls) == 1 else update(*args, **options)

    monkeypatch.setattr(Localizer, 'update', sometimes)
    out = tmp_path / 'evaluation'
    words = ['evaluate', '--suite', 'conditions', '--frames', '1', '--jobs', '1',
             '--set', 'integrity.min_confidence=1.0', '--out', str(out)]
    assert main(words) == 1
    said = capsys.readouterr()
    assert 'missed: conditions: clear: rmse' in said.err
    raised = CONDITIONS[1].name
    assert f'missed: conditions: {raised}: trial 0 raised an exception' in said.err
    assert 'ZeroDivisionError' in said.err
    found = json.loads((out / 'evaluation.json').read_text())
    assert found['frames'] == len(CONDITIONS)
    assert found['parameters'] == {'integrity.min_confidence': 1.0}
    assert len(found['missed']) == said.err.count('missed:')
    assert found['faults'] == 1
    rows = list(csv.DictReader((out / 'evaluation.csv').open()))
    assert list(rows[0]) == list(COLUMNS)
    assert [row['part'] for row in rows] == [condition.name for condition in CONDITIONS]
    assert [row['part'] for row in rows if row['status'] == 'FAULT'] == [raised]
    page = (out / 'report.html').read_text()
    assert all(condition.name in page for condition in CONDITIONS)
    assert main(words) == 1
    assert 'not empty' in capsys.readouterr().err


def test_sections_are_printed_with_what_was_missed():
    section = SUITES['conditions'].summarise([
        Record('conditions', 'clear', k, '', published(0.001 * k)) for k in range(3)
    ])
    words = format_section(section)
    assert words.splitlines()[1].startswith('condition')
    assert 'MISSED night: rmse' in words
    assert 'MISSED clear: rmse of the position' not in words
