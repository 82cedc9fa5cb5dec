# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import resource
import subprocess
import sys

from drive_samples import COARSE, options_of, recorded, rewritten
import pytest

from gip_localizer.cli import main
from gip_localizer.io.bags.bag import Bag
from gip_localizer.parameters import load_parameter_file


def refused(capsys, *words: str) -> str:
    """Run `gip`; it must fail with one line, which is returned."""
    assert main(list(words)) == 1
    error = capsys.readouterr().err.strip()
    assert error.startswith('gip: ')
    return error


def replay(drive, tmp_path, *options):
    return ['replay', str(drive), *options_of(drive), '--out', str(tmp_path / 'out'), *options]


@pytest.mark.parametrize(('options', 'words'), [
    (['--image-topic', '/cam'], ['/cam', '--image-topic', '/image (sensor_msgs/msg/Image']),
    (['--camera-info-topic', '/ci'], ['/ci', '--camera-info-topic', '/camera_info']),
    (['--odom-topic', '/wheel'], ['/wheel', '--odom-topic', '/odom']),
    (['--ground-truth', '/gps'], ['/gps', '--ground-truth', '/ground_truth']),
    (['--image-topic', '/odom'], ['/odom', '--image-topic', '/image']),
    (['--map', '/no/map.yaml'], ['/no/map.yaml']),
    (['--params', '/no/params.yaml'], ['/no/params.yaml']),
    (['--metric', 'manhattan'], ['score.metric', 'manhattan', 'gip_normalized']),
    (['--set', 'search.x'], ['NAME=VALUE']),
    (['--set', 'search.z=1'], ['search.z', 'unknown']),
    (['--set', 'search.x=wide'], ['search.x', 'wide', 'a number']),
    (['--set', 'search.x=-1'], ['search.x', '-1']),
    (['--initial-pose', '1,2'], ['X,Y,YAW']),
    (['--initial-pose', '-1,2,north'], ['X,Y,YAW']),
    (['--ground-truth', '/no/truth.tum'], ['/no/truth.tum']),
    (['--start', '99'], ['no image', '--start']),
    (['--start', 'nan'], ['--start nan', 'expected seconds']),
    (['--start', 'inf'], ['--start inf', 'expected seconds']),
    (['--duration', '-1'], ['--duration -1', 'expected seconds']),
    (['--wrong-xy', '0'], ['--wrong-xy 0', 'metres above 0']),
    (['--wrong-yaw', 'nan'], ['--wrong-yaw nan', 'degrees above 0']),
    (['--relocalize', '--initial-pose', 'truth'], ['--relocalize', 'leave out --initial-pose']),
    (['--no-odometry', '--odom-topic', '/odom'], ['--no-odometry', 'leave out --odom-topic']),
    (['--duration', '1e300'], ['--duration 1e+300', 'expected seconds']),
])
def test_options(drive, tmp_path, capsys, options, words):
    error = refused(capsys, *replay(drive, tmp_path, *options))
    for word in words:
        assert word in error
    assert list(tmp_path.iterdir()) == []


def test_a_negative_initial_pose_is_no_option(drive, tmp_path, capsys):
    main(replay(drive, tmp_path, '--initial-pose', '-1.5,-2,0.1', '--duration', '0.1', *COARSE))
    used = load_parameter_file(tmp_path / 'out' / 'params.yaml').initial_pose
    assert (used.x, used.y, used.yaw) == (-1.5, -2.0, 0.1)


def test_no_such_bag(tmp_path, capsys):
    assert 'no such bag' in refused(capsys, 'replay', str(tmp_path / 'none'), '--map', 'm.yaml',
                                    '--out', str(tmp_path / 'out'))


def test_an_empty_folder(tmp_path, capsys):
    error = refused(capsys, 'replay', str(tmp_path), '--map', 'm.yaml', '--out',
                    str(tmp_path / 'out'))
    assert 'holds no .mcap' in error


def test_no_map(drive, tmp_path, capsys):
    error = refused(capsys, 'replay', str(drive / 'drive.mcap'), '--params',
                    str(drive / 'params.yaml'), '--map', '', '--out', str(tmp_path / 'out'))
    assert 'map' in error


@pytest.mark.parametrize(('left_out', 'words'), [
    ('/image', 'no sensor_msgs/msg/Image'), ('/camera_info', 'no sensor_msgs/msg/CameraInfo'),
])
def test_a_bag_without_a_needed_topic(drive, tmp_path, capsys, left_out, words):
    bag = rewritten(tmp_path / 'a.mcap', [m for m in recorded(drive) if m[0] != left_out])
    error = refused(capsys, 'replay', str(bag), *options_of(drive), '--out', str(tmp_path / 'out'))
    assert words in error
    assert '/odom' in error
    assert not (tmp_path / 'out').exists()


def test_an_encoding_that_is_not_read_is_named(drive, tmp_path, capsys):
    bag = rewritten(tmp_path / 'a.mcap', recorded(drive), encodings={'/image': 'ros1'})
    error = refused(capsys, 'replay', str(bag), *options_of(drive), '--out', str(tmp_path / 'out'))
    assert '/image (sensor_msgs/msg/Image, 25, encoding \'ros1\' is not read)' in error


def test_a_truth_of_another_type_is_told_which_are_read(drive, tmp_path, capsys):
    error = refused(capsys, *replay(drive, tmp_path, '--ground-truth', '/image'))
    assert 'PoseStamped or' in error


def test_two_cameras_are_asked_for(drive, tmp_path, capsys):
    second = [(f'/rear{t}', k, log, raw) for t, k, log, raw in recorded(drive) if t == '/image']
    bag = rewritten(tmp_path / 'a.mcap', recorded(drive) + second)
    error = refused(capsys, 'replay', str(bag), *options_of(drive), '--out', str(tmp_path / 'out'))
    assert '--image-topic' in error
    assert '/rear/image' in error


def test_malformed_truth_names_the_line(drive, tmp_path, capsys):
    truth = tmp_path / 'truth.tum'
    truth.write_text('1.0 0 0 0 0 0 0 1\n2.0 0 0 zero 0 0 0 1\n')
    error = refused(capsys, *replay(drive, tmp_path, '--ground-truth', str(truth)))
    assert f'{truth}:2: ' in error


def test_a_start_that_the_truth_does_not_cover_is_named(drive, tmp_path, capsys):
    stamp = Bag([drive]).start_ns
    truth = tmp_path / 'truth.tum'
    truth.write_text(''.join(f'{stamp * 1e-9 + n:.9f} 0 0 0 0 0 0 1\n' for n in (1, 2)))
    error = refused(capsys, *replay(drive, tmp_path, '--ground-truth', str(truth),
                                    '--initial-pose', 'truth'))
    for words in ('the first image is of', 'ground truth covers', '--start 1.000', 'X,Y,YAW'):
        assert words in error


def test_results_are_kept_without_force(drive, tmp_path, capsys):
    command = replay(drive, tmp_path, '--duration', '0.1', *COARSE)
    assert main(command) == 0
    before = (tmp_path / 'out' / 'metrics.json').read_bytes()
    assert '--force' in refused(capsys, *command)
    assert (tmp_path / 'out' / 'metrics.json').read_bytes() == before
    assert main([*command, '--force']) == 0


def limited(*words: str) -> subprocess.CompletedProcess:
    """Run `gip` where no file may exceed 100 kB: a disk that is full."""
    limit = (100_000, 100_000)
    return subprocess.run(
        [sys.executable, '-m', 'gip_localizer.cli', *words], capture_output=True, text=True,
        timeout=300, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, limit),
    )


def test_a_full_disk_ends_replay_with_one_line(drive, tmp_path):
    done = limited(*replay(drive, tmp_path, '--duration', '0.3', *COARSE))
    assert done.returncode == 1, done.stderr
    assert 'cannot write' in done.stderr
    assert 'Traceback' not in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_ends_simulate_with_one_line(tmp_path):
    done = limited('simulate', '--seconds', '0.3', '--out', str(tmp_path / 'out'))
    assert done.returncode == 1, done.stderr
    assert 'Traceback' not in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('options', 'words'), [
    (['--scenario', 'sunset'], ['sunset', 'clear', 'tiles-low-snr']),
    (['--seconds', '0'], ['--seconds']), (['--quality', '0'], ['--quality']),
    (['--set', 'lens.width=2'], ['lens.width']), (['--set', 'nothing=1'], ['nothing']),
    (['--transport', 'jpeg', '--set', 'sensor.bits=16', '--seconds', '0.1'], ['8 bits']),
    (['--set', 'world.name=/no/map.yaml'], ['/no/map.yaml']), (['--rate', '0'], ['rate']),
    (['--set', 'camera.pitch=-1.0'], ['road']),
])
def test_simulate(tmp_path, capsys, options, words):
    error = refused(capsys, 'simulate', '--out', str(tmp_path / 'out'), *options)
    for word in words:
        assert word in error
    assert list(tmp_path.iterdir()) == []


def test_simulate_replaces_only_bags_and_only_with_force(tmp_path, capsys):
    (tmp_path / 'thesis.tex').write_text('years of work')
    error = refused(capsys, 'simulate', '--out', str(tmp_path), '--force')
    assert 'not replaced' in error
    assert [path.name for path in tmp_path.iterdir()] == ['thesis.tex']
