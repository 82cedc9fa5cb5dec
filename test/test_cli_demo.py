# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip demo` from the outside: exit codes, results, and no process left behind."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import psutil
import pytest

pytest.importorskip('rclpy')

from gip_localizer.cli import main
from gip_localizer.evaluation.demo import missed_bounds, overload

pytestmark = pytest.mark.ros

GOOD = {'availability': 1.0, 'rmse_xy_m': 0.01, 'rmse_yaw_deg': 0.05, 'wrong_published': 0}
DEMO = [sys.executable, '-m', 'gip_localizer.cli', 'demo']
PATIENCE = 300.0
FRAMES = 24
RATES = ('3', '1')
"""Images per second: where the demo finds the machine too busy, it is tried with fewer."""
BUSY = ('is overloaded', 'no pose within', 'missed: availability')


def nodes_of(demo):
    """All nodes below a demo; they have process groups of their own but it is their parent."""
    return [child for child in demo.children(recursive=True) if '-m' in child.cmdline()]


@pytest.mark.parametrize('world', ['road', 'tiles'])
def test_the_demo_meets_its_bounds_and_writes_its_results(tmp_path, world):
    out = tmp_path / 'demo'
    for rate in RATES:
        done = subprocess.run(
            [*DEMO, '--world', world, '--rate', rate, '--seconds', str(FRAMES / float(rate)),
             '--out', str(out), '--force'],
            capture_output=True, text=True, timeout=PATIENCE, check=False,
        )  # fmt: skip
        if not any(words in done.stderr for words in BUSY):
            break
    assert done.returncode == 0, done.stdout + done.stderr
    metrics = json.loads((out / 'metrics.json').read_text())
    assert metrics['frames'] >= FRAMES
    assert missed_bounds(metrics) == []
    assert 'metric' in done.stdout
    names = {path.name for path in out.iterdir()}
    wanted = {'metrics.json', 'report.html', 'estimate.tum', 'ground_truth.tum', 'params.yaml'}
    assert wanted <= names
    assert any(name.endswith('.mcap') for name in names)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_no_process_and_no_results_remain_when_it_is_stopped(tmp_path, number):
    out = tmp_path / 'demo'
    demo = subprocess.Popen(
        [*DEMO, '--world', 'tiles', '--seconds', '60', '--out', str(out)],  # quick to make
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    )  # fmt: skip
    try:
        end = time.monotonic() + PATIENCE
        while len(nodes := nodes_of(psutil.Process(demo.pid))) < 2:
            assert time.monotonic() < end
            assert demo.poll() is None
            time.sleep(0.1)
        demo.send_signal(number)
        assert demo.wait(PATIENCE) in (128 + number, 130)
        gone, alive = psutil.wait_procs(nodes, timeout=PATIENCE)
        assert alive == []
        assert len(gone) == 2
        assert not out.exists()
    finally:
        demo.kill()
        demo.wait()


def test_a_folder_that_holds_something_is_refused_before_anything_starts(tmp_path, capsys):
    (tmp_path / 'mine.txt').write_text('keep')
    assert main(['demo', '--out', str(tmp_path)]) == 1
    assert str(tmp_path) in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ['mine.txt']


@pytest.mark.parametrize('arguments', [
    ['--rate', '0'], ['--seconds', 'soon'], ['--metric', 'manhattan'], ['--rate', '-3'],
])  # fmt: skip
def test_bad_options_are_refused(arguments, capsys):
    with pytest.raises(SystemExit, match='2'):
        main(['demo', *arguments])
    assert arguments[0] in capsys.readouterr().err


def test_an_unknown_world_is_an_error_of_one_line(tmp_path, capsys):
    world, out = str(tmp_path / 'none.yaml'), str(tmp_path / 'out')
    assert main(['demo', '--world', world, '--out', out]) == 1
    error = capsys.readouterr().err
    assert 'none.yaml' in error
    assert len(error.strip().splitlines()) == 1


@pytest.mark.parametrize(('figure', 'value'), [
    ('availability', 0.94), ('rmse_xy_m', 0.031), ('rmse_yaw_deg', 0.21), ('wrong_published', 1),
    ('rmse_xy_m', None), ('availability', None),
])  # fmt: skip
def test_each_bound_is_held(figure, value):
    assert missed_bounds(GOOD) == []
    [line] = missed_bounds({**GOOD, figure: value})
    assert figure in line


def test_a_machine_that_does_not_keep_up_is_told():
    assert overload({'latency_ms': {'p95': 199.0}}, 5.0) == ''
    assert overload({'latency_ms': {'p95': None}}, 5.0) == ''
    said = overload({'latency_ms': {'p95': 250.0}}, 5.0)
    assert 'latency up to 250 ms' in said
    assert 'every 200 ms' in said
    assert '--rate' in said
