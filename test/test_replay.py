# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import json
import os
import re
import signal

from bag_samples import write_rosbag2
from drive_samples import COARSE, options_of, recorded, replayed, rewritten
from mcap.writer import CompressionType
import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
import tqdm

from gip_localizer.cli import main
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.cdr import jazzy
from gip_localizer.io.map_files import load_map, save_map
from gip_localizer.io.tum_files import read_tum

IMAGE, INFO, ODOM, TRUTH = '/image', '/camera_info', '/odom', '/ground_truth'


@pytest.fixture(scope='module')
def messages(drive):
    return recorded(drive)


def without_timings(metrics):
    timings = ('latency_ms', 'frames_per_second')
    return {key: value for key, value in metrics.items() if key not in timings}


def test_the_drive_is_followed(whole):
    out, metrics = whole
    assert metrics['complete'] is True
    assert metrics['frames'] == 25
    assert metrics['published'] >= 24
    assert metrics['rmse_xy_m'] < 0.03
    assert metrics['rmse_yaw_deg'] < 0.2
    assert metrics['wrong_published'] == 0
    assert len(read_tum(out / 'estimate.tum')) == metrics['published']
    assert (out / 'report.html').read_text().count('<h3 id="') == 5


def test_a_second_replay_is_the_same(drive, whole, tmp_path):
    first, metrics = whole
    again = replayed(drive, drive, tmp_path / 'out')
    for name in ('estimate.tum', 'published.mcap', 'ground_truth.tum', 'params.yaml'):
        assert (first / name).read_bytes() == (tmp_path / 'out' / name).read_bytes(), name
    assert without_timings(metrics) == without_timings(again)


FORMS = {
    'lz4': lambda path, m: rewritten(path / 'a.mcap', m, compression=CompressionType.LZ4),
    'zstd': lambda path, m: rewritten(path / 'a.mcap', m, compression=CompressionType.ZSTD),
    'sqlite3': lambda path, m: write_rosbag2(path / 'bag', m, StoragePlugin.SQLITE3),
    'split': lambda path, m: [rewritten(path / f'a_{i}.mcap', m[i * 60:(i + 1) * 60])
                              for i in range(len(m) // 60 + 1)] and path,
    'unknown types': lambda path, m: rewritten(
        path / 'a.mcap', [('/lidar', 'acme_msgs/msg/Sweep', m[0][2], b'\0\1\0\0xyz'), *m]),
}


@pytest.mark.parametrize('form', FORMS)
def test_the_container_changes_nothing(drive, whole, messages, tmp_path, form):
    folder = tmp_path / 'in'
    folder.mkdir()
    bag = FORMS[form](folder, messages)
    metrics = replayed(bag, drive, tmp_path / 'out', '--duration', '1.0')
    read = (tmp_path / 'out' / 'estimate.tum').read_text().splitlines()
    assert metrics['frames'] == 10
    assert read == (whole[0] / 'estimate.tum').read_text().splitlines()[:len(read)]
    assert len(read) >= 9


def test_the_window_is_seconds_after_the_first_message(drive, whole, tmp_path):
    metrics = replayed(drive, drive, tmp_path / 'out', '--start', '0.5', '--duration', '0.5',
                       '--initial-pose', 'truth')
    assert metrics['frames'] == 5
    parameters, truth = metrics['config']['parameters'], read_tum(whole[0] / 'ground_truth.tum')
    [start] = truth.at(read_tum(whole[0] / 'estimate.tum').stamps_ns[[5]])
    assert [parameters[f'initial_pose.{name}'] for name in ('x', 'y', 'yaw')] == pytest.approx(
        start, abs=1e-9)
    assert metrics['published'] == 5


def test_a_window_after_the_only_camera_info_is_calibrated(drive, messages, tmp_path):
    first = next(m for m in messages if m[0] == INFO)
    bag = rewritten(tmp_path / 'a.mcap', [first, *(m for m in messages if m[0] != INFO)])
    metrics = replayed(bag, drive, tmp_path / 'out', '--start', '1.0', '--duration', '0.3',
                       '--initial-pose', 'truth')
    assert metrics['frames'] == 3
    assert 'NO_CALIBRATION' not in metrics['statuses']


def test_an_initial_pose_of_the_beginning_is_doubted_later_on(drive, tmp_path, capsys):
    late = ('--start', '1.5', '--duration', '0.2', '--out', str(tmp_path / 'out'))
    assert main(['replay', str(drive), *options_of(drive), *COARSE, *late]) == 1
    assert re.search(r'initial_pose\.\* is [2-9]\.\d+ m and .* give --initial-pose truth',
                     capsys.readouterr().err)
    replayed(drive, drive, tmp_path / 'new', *late[:4], '--initial-pose', 'truth')
    assert 'initial_pose' not in capsys.readouterr().err


def test_a_camera_info_after_the_images_is_taken_for_all(drive, messages, tmp_path, capsys):
    topic, kind, _, raw = next(m for m in messages if m[0] == INFO)
    rest = [m for m in messages if m[0] != INFO]
    bag = rewritten(tmp_path / 'a.mcap', [*rest, (topic, kind, rest[-1][2], raw)])
    metrics = replayed(bag, drive, tmp_path / 'out', '--duration', '0.5')
    assert metrics['published'] == 5
    assert 'camera_info comes 2.' in capsys.readouterr().err


def test_why_frames_gave_no_pose_is_said(drive, tmp_path, capsys):
    params = tmp_path / 'params.yaml'
    params.write_text((drive / 'params.yaml').read_text().replace('set: true', 'set: false'))
    replayed(drive, drive, tmp_path / 'out', '--duration', '0.5', '--params', str(params),
             expected=1, report=True)
    error = capsys.readouterr().err
    assert 'gip: no pose, NO_PRIOR in 5 of 5 frames, first: no prior yet' in error
    assert 'no frame gave a pose (NO_PRIOR in 5 of 5 frames): give a start with --' in error
    assert '~/relocalize' not in error
    assert 'no pose, NO_PRIOR in 5 of 5' in (tmp_path / 'out' / 'report.html').read_text()


def test_without_truth_the_errors_are_null(drive, messages, tmp_path, capsys):
    bag = rewritten(tmp_path / 'a.mcap', [m for m in messages if m[0] != TRUTH])
    metrics = replayed(bag, drive, tmp_path / 'out', '--duration', '0.5')
    assert metrics['rmse_xy_m'] is None
    assert 'no ground truth, errors are unknown; name a TUM file' in capsys.readouterr().err
    assert metrics['published'] >= 4
    assert not (tmp_path / 'out' / 'ground_truth.tum').exists()


def test_a_truth_of_another_clock_is_said(drive, whole, tmp_path, capsys):
    truth = tmp_path / 'truth.tum'
    truth.write_text('5.0 0 0 0 0 0 0 1\n6.0 0 0 0 0 0 0 1\n')
    metrics = replayed(drive, drive, tmp_path / 'out', '--duration', '0.2', '--ground-truth',
                       str(truth))
    assert metrics['rmse_xy_m'] is None
    assert 'the ground truth covers 5.000 to 6.000 s, the images ' in capsys.readouterr().err


def test_truth_from_a_tum_file(drive, whole, messages, tmp_path):
    bag = rewritten(tmp_path / 'a.mcap', [m for m in messages if m[0] != TRUTH])
    metrics = replayed(bag, drive, tmp_path / 'out', '--ground-truth',
                       str(whole[0] / 'ground_truth.tum'))
    assert metrics['rmse_xy_m'] == pytest.approx(whole[1]['rmse_xy_m'], abs=1e-9)


def test_without_odometry_the_drive_is_still_followed(drive, messages, tmp_path):
    bag = rewritten(tmp_path / 'a.mcap', [m for m in messages if m[0] != ODOM])
    metrics = replayed(bag, drive, tmp_path / 'out')
    assert metrics['wrong_published'] == 0
    assert metrics['published'] >= 20
    assert metrics['rmse_xy_m'] < 0.05


def test_camera_info_once_at_the_start_is_enough(drive, whole, messages, tmp_path):
    first = next(m for m in messages if m[0] == INFO)
    bag = rewritten(tmp_path / 'a.mcap', [first, *(m for m in messages if m[0] != INFO)])
    replayed(bag, drive, tmp_path / 'out', '--duration', '1.0')
    read = (tmp_path / 'out' / 'estimate.tum').read_text().splitlines()
    assert read == (whole[0] / 'estimate.tum').read_text().splitlines()[:len(read)]


def thinned_odometry(messages, every, late_ns):
    """Odometry off the images' grid, logged late."""
    kept = [m for m in messages if m[0] == ODOM][::every]
    late = [(topic, kind, log + late_ns, raw) for topic, kind, log, raw in kept]
    return sorted([m for m in messages if m[0] != ODOM] + late, key=lambda m: m[2])


def test_images_off_the_grid_of_late_odometry(drive, messages, tmp_path):
    bag = rewritten(tmp_path / 'a.mcap', thinned_odometry(messages, 3, 30_000_000))
    metrics = replayed(bag, drive, tmp_path / 'out')
    assert metrics['wrong_published'] == 0
    assert metrics['published'] >= 23
    assert metrics['rmse_xy_m'] < 0.04


def test_a_truncated_bag_is_replayed_as_far_as_it_goes(
    drive, messages, tmp_path, capsys
):
    raw = rewritten(tmp_path / 'whole.mcap', messages).read_bytes()
    cut = tmp_path / 'cut.mcap'
    cut.write_bytes(raw[:len(raw) // 2])
    metrics = replayed(cut, drive, tmp_path / 'out', report=True)
    assert 8 <= metrics['frames'] <= 13
    assert metrics['published'] >= 7
    assert 'truncated' in capsys.readouterr().err
    assert 'truncated' in (tmp_path / 'out' / 'report.html').read_text()


def test_stamps_that_go_back_give_no_wrong_fix(drive, messages, tmp_path):
    images = [m for m in messages if m[0] == IMAGE]
    swapped = {images[i][3]: images[i + 1][3] for i in range(5, 20, 4)}
    swapped |= {after: before for before, after in swapped.items()}
    back = [(t, k, log, swapped.get(raw, raw)) for t, k, log, raw in messages]
    metrics = replayed(rewritten(tmp_path / 'a.mcap', back), drive, tmp_path / 'out')
    assert metrics['wrong_published'] == 0
    assert metrics['statuses']['OUT_OF_ORDER'] >= 4
    assert metrics['published'] >= 15


def other_place(drive, kind):
    here = load_map(drive / 'map.yaml')
    if kind == 'mirrored':
        return replace(here, grey=np.ascontiguousarray(here.grey[::-1]))
    tiles = np.random.default_rng(4).integers(80, 170, [side // 6 + 1 for side in here.grey.shape])
    grey = np.kron(tiles, np.ones((6, 6))).astype(np.uint8)
    return replace(here, grey=grey[:here.grey.shape[0], :here.grey.shape[1]])


@pytest.mark.parametrize('kind', ['mirrored', 'tiles'])
def test_a_map_of_another_place_gives_no_fix(drive, tmp_path, kind):
    save_map(other_place(drive, kind), tmp_path / 'map.yaml')
    code = main(['replay', str(drive), '--params', str(drive / 'params.yaml'), *COARSE, '--map',
                 str(tmp_path / 'map.yaml'), '--out', str(tmp_path / 'out'), '--duration', '0.6'])
    metrics = json.loads((tmp_path / 'out' / 'metrics.json').read_text())
    assert code == 1
    assert metrics['frames'] == 6
    assert metrics['wrong_published'] == 0
    assert metrics['published'] == 0


def test_ctrl_c_leaves_valid_results_marked_incomplete(
    drive, tmp_path, monkeypatch, capsys
):
    update = tqdm.tqdm.update
    seen = []

    def interrupting(bar, n=1):
        seen.append(n)
        if len(seen) == 6:
            os.kill(os.getpid(), signal.SIGINT)
        return update(bar, n)

    monkeypatch.setattr(tqdm.tqdm, 'update', interrupting)
    out = tmp_path / 'out'
    assert main(['replay', str(drive), *COARSE, '--out', str(out)]) == 130
    metrics = json.loads((out / 'metrics.json').read_text())
    assert metrics['complete'] is False
    assert metrics['frames'] == 6
    assert 'Incomplete' in (out / 'report.html').read_text()
    assert Bag([out / 'published.mcap']).notes == []
    assert 'stopped' in capsys.readouterr().err


def test_metric_and_settings_are_used_and_written(drive, tmp_path):
    metrics = replayed(drive, drive, tmp_path / 'out', '--duration', '0.3', '--metric', 'gip',
                       '--set', 'search.x=0.6', '--set', 'score.robust=false')
    parameters = metrics['config']['parameters']
    assert parameters['score.metric'] == 'gip'
    assert parameters['search.x'] == 0.6
    assert parameters['score.robust'] is False
    assert 'metric: gip\n' in (tmp_path / 'out' / 'params.yaml').read_text()
    assert not (tmp_path / 'out' / 'report.html').exists()  # --no-report


def test_images_that_do_not_decode_are_counted(drive, messages, tmp_path):
    images = [m for m in messages if m[0] == IMAGE]
    broken = jazzy().deserialize_cdr(images[3][3], images[3][1])
    broken.encoding = 'yuv1000'
    raw = bytes(jazzy().serialize_cdr(broken, images[3][1]))
    changed = [(t, k, log, raw if r is images[3][3] else r) for t, k, log, r in messages]
    metrics = replayed(rewritten(tmp_path / 'a.mcap', changed), drive, tmp_path / 'out',
                       '--duration', '0.8')
    assert metrics['statuses']['BAD_IMAGE'] == 1
    assert metrics['frames'] == 8
