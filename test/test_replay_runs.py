# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip replay` of several bags, without prior or odometry, and with other bounds."""

from __future__ import annotations

import json

from bag_samples import EPOCH, image, odometry, serialized, write_mcap
from drive_samples import COARSE, options_of, recorded, replayed, rewritten
import pytest
from run_samples import Frame

from gip_localizer.cli import main
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.no_pose import no_pose_advice
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.recordings import recordings

IMAGE, ODOM = 'sensor_msgs/msg/Image', 'nav_msgs/msg/Odometry'
INFO = 'sensor_msgs/msg/CameraInfo'
SECOND = 1_000_000_000


def bag_of(path, topic, kind, begin_s, end_s):
    """A bag with one topic that has a message at the beginning and one at the end."""
    make = image if kind == IMAGE else (lambda stamp: odometry(stamp, Pose2(0.0, 0.0, 0.0)))
    stamps = [EPOCH + int(second * SECOND) for second in (begin_s, end_s)]
    return write_mcap(path, serialized((topic, kind, stamp, make(stamp)) for stamp in stamps))


@pytest.fixture
def parts(tmp_path):
    def named(*bags):
        return [bag_of(tmp_path / f'{n}.mcap', *bag) for n, bag in enumerate(bags)]
    return named


@pytest.mark.parametrize(('named', 'expected'), [(None, [[0], [1]]), ('cam', [[0, 1]])])
def test_two_calibrated_cameras_are_two_runs_unless_one_is_named(parts, named, expected):
    paths = parts(('/cam', IMAGE, 0, 5), ('/rear', IMAGE, 0, 5))
    for path, topic in zip(paths, ('/cam', '/rear'), strict=True):
        frames = [(m.topic, m.msgtype, m.log_ns, bytes(m.raw))
                  for m in Bag([path]).messages([topic])]
        write_mcap(path, [(f'{topic}/camera_info', INFO, EPOCH, b''), *frames])
    assert numbers(recordings(paths, named)) == expected


def numbers(groups):
    return [[int(path.stem) for path in group] for group in groups]


@pytest.mark.parametrize(('bags', 'expected'), [
    ([('/cam', IMAGE, 0, 5), ('/cam', IMAGE, 5.1, 9)], [[0, 1]]),  # a split recording
    ([('/cam', IMAGE, 5.1, 9), ('/cam', IMAGE, 0, 5)], [[1, 0]]),
    ([('/cam', IMAGE, 0, 5), ('/cam', IMAGE, 0, 9)], [[0], [1]]),  # stamps of one simulation
    ([('/cam', IMAGE, 0, 5), ('/cam', IMAGE, 60, 65)], [[0], [1]]),  # two drives of one day
    ([('/cam', IMAGE, 0, 5), ('/odom', ODOM, 0, 5)], [[0, 1]]),
    ([('/cam', IMAGE, 0, 5), ('/rear', IMAGE, 0, 5)], [[0, 1]]),
    ([('/cam', IMAGE, 0, 5), ('/cam', IMAGE, 60, 65), ('/odom', ODOM, 0, 70)], [[0, 2], [1, 2]]),
    ([('/odom', ODOM, 0, 5), ('/pose', ODOM, 0, 5)], [[0, 1]]),
])
def test_parts_of_one_recording_are_read_together(parts, bags, expected):
    assert numbers(recordings(parts(*bags))) == expected


def test_two_drives_are_two_runs(drive, tmp_path, capsys):
    part = [m for m in recorded(drive) if m[2] < EPOCH + 350_000_000]
    for folder in ('a', 'b'):
        (tmp_path / folder).mkdir()
    bags = [rewritten(tmp_path / folder / 'd.mcap', part) for folder in ('a', 'b')]
    code = main(['replay', *map(str, bags), *options_of(drive), *COARSE, '--out',
                 str(tmp_path / 'out')])
    assert code == 0
    for name in ('d_1', 'd_2'):
        metrics = json.loads((tmp_path / 'out' / name / 'metrics.json').read_text())
        assert (metrics['frames'], metrics['published']) == (4, 4)
    assert 'gip compare' in capsys.readouterr().out


def test_the_map_is_searched_without_a_prior(drive, tmp_path):
    metrics = replayed(drive, drive, tmp_path / 'out', '--relocalize', '--duration', '0.5',
                       '--set', 'initial_pose.x=900.0')
    assert metrics['published'] >= 1
    assert metrics['wrong_published'] == 0
    assert metrics['config']['parameters']['initial_pose.set'] is False
    assert 'searched' in metrics['config']['start']


def test_odometry_can_be_left_out(drive, tmp_path):
    metrics = replayed(drive, drive, tmp_path / 'out', '--no-odometry', '--duration', '0.2')
    assert 'not used' in metrics['config']['odometry']


def test_the_bounds_of_a_wrong_pose_can_be_chosen(drive, tmp_path, capsys):
    metrics = replayed(drive, drive, tmp_path / 'out', '--duration', '0.2', '--wrong-xy', '1e-7')
    assert metrics['wrong_published'] == 2
    assert 'wrong poses published (error above 1e-07 m or 2 deg)' in capsys.readouterr().out


@pytest.mark.parametrize(('statuses', 'words'), [
    (['NO_PRIOR'] * 3, '--initial-pose'), (['NO_MATCH', *['LOST'] * 9], 'check-calibration'),
    (['LOST'], '--relocalize'), (['NO_CALIBRATION'], '--camera-info-topic'),
    (['OFF_MAP'], '--map'),
])
def test_the_advice_follows_the_cause(statuses, words):
    advice = no_pose_advice([Frame(n, None, status=word) for n, word in enumerate(statuses)])
    assert f'{statuses[0]} in' in advice
    assert words in advice


def test_there_is_no_advice_where_a_frame_gave_a_pose():
    frames = [Frame(0, None, status='LOST'), Frame(1, Pose2(0.0, 0.0, 0.0))]
    assert no_pose_advice(frames) == ''
    assert no_pose_advice([]) == ''
