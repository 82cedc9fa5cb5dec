# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from pathlib import Path

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
    write_results(plain, noisy_run())
    changed = Parameters.from_dict({'score.metric': 'euclidean'})
    write_results(other, noisy_run(scale=3.0, withheld=9, parameters=changed))
    return [str(plain), str(other)]


def compare(runs, tmp_path, *options):
    return main(['compare', *runs, '--out', str(tmp_path / 'out'), *options])


def line_of(text, start):
    return next(line.split() for line in text.splitlines() if line.startswith(start))


def test_figures_stand_side_by_side(runs, tmp_path, capsys):
    assert compare(runs, tmp_path) == 0
    text = capsys.readouterr().out
    assert line_of(text, 'Metrics')[1:] == ['plain', 'other']
    assert line_of(text, 'published')[-2:] == ['60', '51']
    first, second = map(float, line_of(text, 'position error, rms')[-2:])
    assert second > 2.0 * first


def test_only_parameters_that_differ_are_listed(runs, tmp_path, capsys):
    compare(runs, tmp_path)
    below = capsys.readouterr().out.split('Parameters that differ')[1]
    assert line_of(below, 'score.metric')[1:] == ['gip_normalized', 'euclidean']
    assert 'search.x' not in below


def test_the_figure_overlays_all_runs(runs, tmp_path):
    compare(runs, tmp_path)
    picture = cv2.imread(str(tmp_path / 'out' / 'compare.png'))
    assert picture is not None
    assert min(picture.shape[:2]) > 500
    axes = comparison_figure(read_runs([Path(run) for run in runs])).axes[0]
    assert [line.get_label() for line in axes.lines] == ['plain', 'other']
    np.testing.assert_allclose(
        np.sqrt(np.mean((axes.lines[0].get_ydata() / 1e3) ** 2)),
        read_runs([Path(runs[0])])[0].metrics['rmse_xy_m'], atol=1e-9,
    )


def test_the_page_holds_tables_and_figure(runs, tmp_path):
    compare(runs, tmp_path)
    page = (tmp_path / 'out' / 'compare.html').read_text()
    assert 'data:image/svg+xml' in page
    assert 'score.metric' in page


def test_runs_of_one_name_are_told_apart_by_their_parents(tmp_path, capsys):
    for parent in ('a', 'b'):
        write_results(tmp_path / parent / 'run', noisy_run(count=4))
    compare([str(tmp_path / p / 'run') for p in ('a', 'b')], tmp_path)
    assert line_of(capsys.readouterr().out, 'Metrics')[1:] == ['a/run', 'b/run']


@pytest.mark.parametrize('changes', [{'truth': None}, {'estimates': []}, {'withheld': 60}])
def test_a_run_without_errors_stands_beside_others(runs, tmp_path, capsys, changes):
    write_results(tmp_path / 'thin', noisy_run(**changes))
    assert compare([*runs, str(tmp_path / 'thin')], tmp_path) == 0
    assert line_of(capsys.readouterr().out, 'position error, rms')[-1] == 'unknown'


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


@pytest.mark.parametrize('config', ['[1]', '{"parameters": [1]}', 'null', '"x"'])
def test_a_run_without_readable_parameters_stands_beside_others(runs, tmp_path, config):
    bare = tmp_path / 'bare'
    bare.mkdir()
    (bare / 'metrics.json').write_text(f'{{"frames": 3, "config": {config}}}')
    assert compare([*runs, str(bare)], tmp_path) == 0


@pytest.mark.parametrize('verb', ['replay', 'compare', 'map', 'check-calibration'])
def test_a_name_that_no_file_can_have_is_told(verb, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # where no results of an earlier run are in the way
    assert main([verb, 'a' * 3000]) == 1
    error = capsys.readouterr().err
    assert 'File name too long' in error
    assert error.startswith('gip: aaa')


def test_a_comparison_is_not_replaced_without_force(runs, tmp_path, capsys):
    assert compare(runs, tmp_path) == 0
    assert compare(runs, tmp_path) == 1
    assert '--force' in capsys.readouterr().err
    assert compare(runs, tmp_path, '--force') == 0
