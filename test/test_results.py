# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import errno
import json
from pathlib import Path

import numpy as np
import pytest
from run_samples import EPOCH, noisy_run

from gip_localizer.errors import OutputError
from gip_localizer.evaluation.results import write_results
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.map_files import load_map
from gip_localizer.io.tum_files import read_tum
from gip_localizer.parameters import load_parameter_file, Parameters

FILES = ('metrics.json', 'report.html', 'frames.csv', 'estimate.tum', 'ground_truth.tum',
         'params.yaml', 'published.mcap')


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_folder_is_whole_and_latest_points_to_it(tmp_path):
    metrics = write_results(tmp_path / 'results' / 'demo', noisy_run())
    out = tmp_path / 'results' / 'demo'
    assert names(out) == set(FILES)
    assert names(out.parent) == {'demo', 'latest'}
    assert (out.parent / 'latest').resolve() == out.resolve()
    assert json.loads((out / 'metrics.json').read_text()) == json.loads(json.dumps(metrics))
    assert load_parameter_file(out / 'params.yaml') == Parameters()
    assert len(read_tum(out / 'estimate.tum')) == 60


def test_the_bag_holds_what_a_node_would_have_published(tmp_path):
    run = noisy_run(withheld=10)
    write_results(tmp_path / 'out', run, report=False)
    bag = Bag([tmp_path / 'out' / 'published.mcap'])
    assert bag.notes == []
    assert {topic.name: topic.messages for topic in bag.topics} == {
        '/pose': 50, '/pose_with_covariance': 50, '/diagnostics': 60
    }
    messages = list(bag.messages(['/pose_with_covariance', '/diagnostics']))
    first = bag.decode(messages[0])
    assert first.status[0].level == 2
    assert first.status[0].message == 'LOST: no match'
    last = bag.decode(messages[-1])
    covariance = last.pose.covariance.reshape(6, 6)[np.ix_((0, 1, 5), (0, 1, 5))]
    np.testing.assert_array_equal(covariance, run.estimates[-1].covariance)
    assert last.header.frame_id == 'map'
    assert last.pose.pose.position.x == run.estimates[-1].pose.x


def test_the_same_run_gives_the_same_bytes(tmp_path):
    for name in ('a', 'b'):
        write_results(tmp_path / name / 'out', noisy_run())
    for file in FILES:
        first, second = ((tmp_path / name / 'out' / file).read_bytes() for name in ('a', 'b'))
        assert first == second, file


def test_stamps_before_1970_have_a_valid_folder(tmp_path):
    run = noisy_run(count=3)
    early = [replace(frame, stamp_ns=frame.stamp_ns - 2 * EPOCH) for frame in run.estimates]
    write_results(tmp_path / 'out', replace(run, estimates=early))
    assert list(read_tum(tmp_path / 'out' / 'estimate.tum').stamps_ns) == [
        frame.stamp_ns for frame in early
    ]


def test_results_are_not_replaced_without_force(tmp_path):
    out = tmp_path / 'out'
    write_results(out, noisy_run(), report=False)
    before = (out / 'metrics.json').read_bytes()
    with pytest.raises(OutputError, match='--force'):
        write_results(out, noisy_run(count=7))
    assert (out / 'metrics.json').read_bytes() == before
    assert write_results(out, noisy_run(count=7), force=True, report=False)['frames'] == 7
    assert names(tmp_path) == {'out', 'latest'}


def test_a_folder_that_no_run_wrote_is_never_replaced(tmp_path):
    out = tmp_path / 'home'
    out.mkdir()
    (out / 'thesis.tex').write_text('years of work')
    with pytest.raises(OutputError, match='not replaced'):
        write_results(out, noisy_run(), force=True)
    assert names(out) == {'thesis.tex'}


def test_a_file_in_the_way_is_refused(tmp_path):
    (tmp_path / 'out').write_text('a file')
    with pytest.raises(OutputError, match='is a file'):
        write_results(tmp_path / 'out', noisy_run(), force=True)


def test_something_called_latest_is_left_alone(tmp_path):
    (tmp_path / 'latest').mkdir()
    write_results(tmp_path / 'out', noisy_run(count=5), report=False)
    assert (tmp_path / 'latest').is_dir()
    assert not (tmp_path / 'latest').is_symlink()


def test_a_full_disk_leaves_the_old_results_and_no_rest(tmp_path, monkeypatch):
    out = tmp_path / 'out'
    write_results(out, noisy_run(count=5), report=False)
    write_text = Path.write_text

    def full(self, *args, **kwargs):
        if self.name == 'report.html':
            raise OSError(errno.ENOSPC, 'No space left on device')
        return write_text(self, *args, **kwargs)

    monkeypatch.setattr(Path, 'write_text', full)
    with pytest.raises(OutputError, match='No space left'):
        write_results(out, noisy_run(count=9), force=True)
    assert names(tmp_path) == {'out', 'latest'}
    assert json.loads((out / 'metrics.json').read_text())['frames'] == 5


def test_an_incomplete_run_is_marked(tmp_path):
    metrics = write_results(tmp_path / 'out', noisy_run(complete=False))
    assert metrics['complete'] is False
    assert 'Incomplete' in (tmp_path / 'out' / 'report.html').read_text()


@pytest.mark.parametrize('changes', [
    {'estimates': []}, {'estimates': [], 'truth': None, 'raster_map': None},
    {'truth': None, 'exhibits': []}, {'withheld': 60}, {'count': 1},
])
def test_thin_runs_have_valid_folders(tmp_path, changes):
    metrics = write_results(tmp_path / 'out', noisy_run(**changes))
    assert metrics['frames'] in (0, 1, 60)
    assert (tmp_path / 'out' / 'ground_truth.tum').exists() is ('truth' not in changes)


def test_a_map_that_only_the_run_has_is_kept_and_named(tmp_path):
    out = tmp_path / 'out'
    metrics = write_results(out, noisy_run(keep_map=True))
    assert names(out) == {*FILES, 'map.yaml', 'map.png'}
    named = load_parameter_file(out / 'params.yaml').map_file
    assert named == metrics['config']['parameters']['map_file'] == str(out / 'map.yaml')
    assert load_map(named).grey.shape == (300, 300)
