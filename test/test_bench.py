# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark: that peers do the same work, that winners agree, and what is written."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from gip_localizer.benchmark.children import child
from gip_localizer.benchmark.opencv_baseline import baseline_winner
from gip_localizer.benchmark.output import as_markdown, write_bench
from gip_localizer.benchmark.rows import compared_row, exponent, interleaved, Row, spread
from gip_localizer.benchmark.scene import Scene, TRACK, Window
from gip_localizer.benchmark.search_process import coarse_to_fine, global_level, score_all
from gip_localizer.benchmark.search_rows import wilson
from gip_localizer.cli import main
from gip_localizer.errors import GipError
from gip_localizer.parameters import Birdseye

KEYS = ['suite', 'case', 'ours_ms', 'peer', 'peer_ms', 'ratio', 'same_winner']
SMALL = Window(0.5, 0.4, math.radians(2.0), math.radians(1.0))


@pytest.fixture(scope='module')
def scene():
    return Scene(60.0, Birdseye(2.5, 8.5, 2.5, 0.1))


def test_opencv_chooses_the_same_candidate(scene):
    rng = np.random.default_rng(5)
    for _ in range(8):
        level, truth = scene.level(rng, SMALL)
        found = score_all(level)
        assert found.index == baseline_winner(level)
        assert coarse_to_fine(level).index == found.index
        # along plain paint cells are alike
        assert np.abs(np.array(found.index) - truth).max() < 3.0


def test_the_noise_of_the_views_is_what_the_weights_say(scene):
    rng = np.random.default_rng(6)
    pose = scene.place(rng)
    views = np.stack([scene.view(pose, rng) for _ in range(100)])
    seen = scene.weight > 0.0
    chi_square = (views.var(axis=0, ddof=1) * scene.weight)[seen].mean()
    assert chi_square == pytest.approx(1.0, abs=0.02)
    assert not views[:, ~seen].any()


def test_the_global_suite_covers_every_heading_and_stays_on_its_map(scene):
    scene_100 = Scene(100.0, Birdseye(2.5, 8.5, 2.5, 0.5))
    level = global_level(scene_100, np.random.default_rng(7))
    yaws = level.lattice.yaws
    assert len(yaws) == 360
    assert np.diff(yaws) == pytest.approx(math.radians(1.0))
    assert level.known.all()


def test_interleaving_takes_turns_and_drops_the_warm_rounds():
    order = []
    work = {name: lambda name=name: order.append(name) for name in 'ab'}
    times = interleaved(work, 3, warm=2)
    assert order == ['a', 'b'] * 5
    assert [len(t) for t in times.values()] == [3, 3]
    assert all(t >= 0.0 for each in times.values() for t in each)


def test_statistics_are_what_they_say():
    assert spread(list(range(101))) == (10.0, 90.0)
    sizes = [1.0, 10.0, 100.0]
    assert exponent(sizes, [2.0 * n**1.5 for n in sizes]) == pytest.approx(1.5)
    low, high = wilson(10, 100)
    assert (low, high) == pytest.approx((0.0552, 0.1744), abs=1e-4)
    assert wilson(0, 50)[0] == 0.0
    assert compared_row('s', 'c', 2.0, 'p', 10.0).ratio == 5.0


def test_the_folder_holds_the_rows_under_their_names(tmp_path):
    rows = [compared_row('track', 'a case', 2.0, 'peer', 8.0, 0.999), Row('frame', 'alone', 3.0)]
    points = [{'axis': 'yaws', 'size': n, 'search': s, 'ms': float(n)}
              for n in (1, 10, 100) for s in ('exhaustive', 'coarse to fine', 'peer')]
    write_bench(tmp_path / 'out', rows, {'growth': points}, force=False)
    written = json.loads((tmp_path / 'out' / 'bench.json').read_text())
    assert [list(row) for row in written] == [KEYS, KEYS]
    assert written[0]['ratio'] == 4.0
    assert written[1]['peer_ms'] is None
    assert (tmp_path / 'out' / 'growth-yaws.png').stat().st_size > 5000
    assert '| track | a case | 2 ms | peer | 8 ms | 4.00 | 99.9% |' in as_markdown(rows)


def test_a_child_that_fails_is_told_with_its_last_words():
    with pytest.raises(GipError, match='no_such_module'):
        child('gip_localizer.no_such_module', [], {})


def test_the_verb_measures_and_writes(tmp_path, capsys):
    out = tmp_path / 'bench'
    assert main(['bench', '--quick', '--suite', 'rectify', '--out', str(out)]) == 0
    (row,) = json.loads((out / 'bench.json').read_text())
    assert row['suite'] == 'rectify'
    assert row['ratio'] == pytest.approx(row['peer_ms'] / row['ours_ms'])
    details = json.loads((out / 'details.json').read_text())
    assert details['machine']['opencv']
    law = details['rectify']['variance_over_law']
    assert law['above 40 px'] == pytest.approx(1.0, abs=0.12)
    assert str(out) in capsys.readouterr().out
    assert main(['bench', '--quick', '--suite', 'rectify', '--out', str(out)]) == 1
    assert 'not empty' in capsys.readouterr().err


def test_a_window_of_the_track_suite_has_the_size_it_names():
    scene = Scene(60.0)
    assert scene.lattice(scene.place(np.random.default_rng(0)), TRACK).shape == (11, 21, 21)
