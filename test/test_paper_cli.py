# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip paper` from the shell's side: files, exit codes, one-line errors, nothing half done."""

import csv
import shutil

import pytest

from gip_localizer.cli import main
from gip_localizer.paper.output import CURVES_COLUMNS


def gip_paper(*args):
    return main(['paper', '--samples', '20', *map(str, args)])


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """The results with seed 5; not to be changed."""
    out = tmp_path_factory.mktemp('results') / 'deep' / 'paper'
    assert gip_paper('--out', out, '--seed', '5') == 0
    return out


def test_writes_curves_and_figures(written):
    assert sorted(path.name for path in written.iterdir()) == [
        'curves.csv', 'figure.png', 'figure.svg',
    ]
    with (written / 'curves.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert tuple(rows[0]) == CURVES_COLUMNS
    assert len(rows) == 100
    assert float(rows[9]['generalized_exact']) == pytest.approx(2.823068e-01, abs=5e-8)
    assert float(rows[49]['standard_paper']) == 0.021560304


def test_same_seed_same_bytes_and_numbers_on_the_screen(written, tmp_path, capsys):
    assert gip_paper('--out', tmp_path / 'again', '--seed', '5') == 0
    assert '2.823068e-01' in capsys.readouterr().out
    for name in ('curves.csv', 'figure.png', 'figure.svg'):
        assert (tmp_path / 'again' / name).read_bytes() == (written / name).read_bytes()


@pytest.mark.parametrize(
    ('args', 'message'),
    [
        (['--samples', '0'], '--samples 1 or more'),
        (['--seed', '-3'], '--seed 0 or more'),
        (['--square', '900'], 'no whole square'),
        (['--pitch', '5'], 'horizon'),
        (['--height', 'nan'], 'height is nan'),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(tmp_path, capsys, args, message):
    assert gip_paper('--out', tmp_path / 'out', *args) == 1
    error = capsys.readouterr().err
    assert message in error
    assert error.count('\n') == 1
    assert list(tmp_path.iterdir()) == []


def test_results_are_replaced_only_with_force(written, tmp_path, capsys):
    shutil.copytree(written, tmp_path / 'out')
    before = (tmp_path / 'out' / 'curves.csv').read_bytes()
    capsys.readouterr()
    assert gip_paper('--out', tmp_path / 'out', '--seed', '1') == 1
    assert '--force' in capsys.readouterr().err
    assert (tmp_path / 'out' / 'curves.csv').read_bytes() == before
    assert gip_paper('--out', tmp_path / 'out', '--seed', '1', '--force') == 0
    assert (tmp_path / 'out' / 'curves.csv').read_bytes() != before
    assert [path.name for path in tmp_path.iterdir()] == ['out']


@pytest.mark.parametrize('force', [[], ['--force']])
def test_other_files_are_never_replaced(tmp_path, capsys, force):
    (tmp_path / 'diary.txt').write_text('mine')
    assert gip_paper('--out', tmp_path, *force) == 1
    assert 'not empty' in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['diary.txt']


def test_unwritable_folder(tmp_path, capsys):
    (tmp_path / 'file').write_text('')
    assert gip_paper('--out', tmp_path / 'file') == 1
    assert gip_paper('--out', tmp_path / 'file' / 'below') == 1
    assert 'Traceback' not in capsys.readouterr().err
