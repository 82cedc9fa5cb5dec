# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import contextlib
import io
from pathlib import Path
import shutil

import cv2
import numpy as np
import pytest
from run_samples import noisy_run

from gip_localizer.cli import main
from gip_localizer.evaluation.compare import comparison_figure, read_runs
from gip_localizer.evaluation.results import write_results
from gip_localizer.parameters import Parameters


@pytest.fixture(scope='module')
def runs(tmp_path_factory):
    """Two results folders, to be read only."""
    folder = tmp_path_factory.mktemp('runs')
    plain, other = folder / 'plain', folder / 'other'
    write_results(plain, noisy_run(), report=False)
    changed = Parameters.from_dict({'score.metric': 'euclidean'})
    write_results(other, noisy_run(scale=3.0, withheld=9, parameters=changed), report=False)
    return [str(plain), str(other)]


def compare(runs, tmp_path, *options):
    return main(['compare', *runs, '--out', str(tmp_path / 'out'), *options])


@pytest.fixture(scope='module')
def compared(runs, tmp_path_factory):
    """The folder of a comparison, and what it printed."""
    out, said = tmp_path_factory.mktemp('compared'), io.StringIO()
    with contextlib.redirect_stdout(said):
        assert compare(runs, out) == 0
    return out / 'out', said.getvalue()


def line_of(text, start):
    return next(line.split() for line in text.splitlines() if line.startswith(start))


def test_figures_stand_side_by_side(compared):
    _, text = compared
    assert line_of(text, 'Metrics')[1:] == ['plain', 'other']
    assert line_of(text, 'published')[-2:] == ['60', '51']
    first, second = map(float, line_of(text, 'position error, rms')[-2:])
    assert second > 2.0 * first


def test_only_parameters_that_differ_are_listed(compared):
    below = compared[1].split('Parameters that differ')[1]
    assert line_of(below, 'score.metric')[1:] == ['gip_normalized', 'euclidean']
    assert 'search.x' not in below


def test_the_figure_overlays_all_runs(runs, compared):
    picture = cv2.imread(str(compared[0] / 'compare.png'))
    assert picture is not None
    assert min(picture.shape[:2]) > 500
    axes = comparison_figure(read_runs([Path(run) for run in runs])).axes[0]
    assert [line.get_label() for line in axes.lines] == ['plain', 'other']
    np.testing.assert_allclose(
        np.sqrt(np.mean((axes.lines[0].get_ydata() / 1e3) ** 2)),
        read_runs([Path(runs[0])])[0].metrics['rmse_xy_m'], atol=1e-9,
    )


def test_the_page_holds_tables_and_figure(compared):
    page = (compared[0] / 'compare.html').read_text()
    assert 'data:image/svg+xml' in page
    assert 'score.metric' in page


def test_runs_of_one_name_are_told_apart_by_their_parents(runs, tmp_path, capsys):
    for parent, run in zip('ab', runs, strict=True):
        shutil.copytree(run, tmp_path / parent / 'run')
    compare([str(tmp_path / p / 'run') for p in ('a', 'b')], tmp_path)
    assert line_of(capsys.readouterr().out, 'Metrics')[1:] == ['a/run', 'b/run']


def test_runs_without_errors_stand_beside_others(runs, tmp_path, capsys):
    thin = {'truthless': {'truth': None}, 'empty': {'estimates': []}, 'silent': {'withheld': 60}}
    for name, changes in thin.items():
        write_results(tmp_path / name, noisy_run(**changes), report=False)
    assert compare([*runs, *(str(tmp_path / name) for name in thin)], tmp_path) == 0
    assert line_of(capsys.readouterr().out, 'position error, rms')[-3:] == ['unknown'] * 3


@pytest.mark.parametrize(('name', 'content', 'words'), [
    (None, None, 'gip replay'), ('metrics.json', '{"frames"', 'no JSON'),
    ('metrics.json', '[1]', 'frames'), ('metrics.json', '{"frames": "many"}', "'many'"),
    ('metrics.json', '{"frames": 3, "latency_ms": {"p50": [1]}}', 'latency_ms.p50'),
    ('metrics.json', '{"frames": null}', 'frames'),
])
def test_what_is_no_run_is_refused(runs, tmp_path, capsys, name, content, words):
    bad = tmp_path / 'bad'
    bad.mkdir()
    if name:
        (bad / name).write_text(content)
    assert compare([*runs, str(bad)], tmp_path) == 1
    error = capsys.readouterr().err
    assert words in error
    assert 'bad' in error
    assert not (tmp_path / 'out').exists()


def test_runs_without_readable_parameters_stand_beside_others(runs, tmp_path):
    bare = []
    for number, config in enumerate(['[1]', '{"parameters": [1]}', 'null', '"x"']):
        bare.append(tmp_path / f'bare {number}')
        bare[-1].mkdir()
        (bare[-1] / 'metrics.json').write_text(f'{{"frames": 3, "config": {config}}}')
    assert compare([*runs, *map(str, bare)], tmp_path) == 0


@pytest.mark.parametrize('verb', ['replay', 'compare', 'map', 'check-calibration'])
def test_a_name_that_no_file_can_have_is_told(verb, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where no results of an earlier run are in the way
    assert main([verb, 'a' * 3000]) == 1
    error = capsys.readouterr().err
    assert 'File name too long' in error
    assert error.startswith('gip: aaa')


def test_a_comparison_is_not_replaced_without_force(runs, compared, tmp_path, capsys):
    shutil.copytree(compared[0], tmp_path / 'out')
    assert compare(runs, tmp_path) == 1
    assert '--force' in capsys.readouterr().err
    assert compare(runs, tmp_path, '--force') == 0
