# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip calibrate`: the mounting pose from frames with known poses on a map."""

from __future__ import annotations

import json
import math

import cv2
from drive_samples import recorded, rewritten
import numpy as np
import pytest

from gip_localizer.cli import main
from gip_localizer.mapping.mount_calibration import COMPONENTS
from gip_localizer.parameters import load_parameter_file

WRONG = {'y': -0.05, 'z': 0.05, 'roll': 0.03, 'pitch': 0.04, 'yaw': -0.04}
FEW = ('--frames', '5', '--set', 'birdseye.resolution=0.1')


def shifted(drive):
    """Options that move the mounting pose of a drive by `WRONG`."""
    held = load_parameter_file(drive / 'params.yaml').camera
    return [word for name in WRONG
            for word in ('--set', f'camera.{name}={getattr(held, name) + WRONG[name]}')]


def test_a_wrong_mounting_pose_is_corrected_and_written(drive, tmp_path, capsys):
    out = tmp_path / 'calibration'
    words = ['calibrate', str(drive), *FEW, *shifted(drive), '--fix', 'x', '--out', str(out)]
    assert main(words) == 0
    truth, found = (load_parameter_file(folder / 'params.yaml').camera for folder in (drive, out))
    errors = np.array([getattr(found, name) - getattr(truth, name) for name in COMPONENTS])
    assert errors[0] == 0.0
    assert np.abs(errors[:3]).max() < 0.005
    assert np.abs(errors[3:]).max() < math.radians(0.05)
    said = json.loads((out / 'calibration.json').read_text())
    assert said['frames_used'] >= 4
    assert np.array(said['covariance']).shape == (6, 6)
    assert f'--pitch {found.pitch:.6f}' in (out / 'static_transform.sh').read_text()
    before, after = (cv2.imread(str(out / f'{name}.png')) for name in ('before', 'after'))
    assert (before != after).any()
    assert 'frames that agree' in capsys.readouterr().out
    again = ['calibrate', str(drive), '--out', str(out)]
    assert main([*again, '--frames', '2']) == 1
    assert main(again) == 1
    assert '--force' in capsys.readouterr().err


@pytest.mark.parametrize(('options', 'words'), [
    (('--set', 'camera.pitch=-0.26', '--frames', '3'), ['frames agree', 'looks down']),
    (('--map', '/no/map.yaml'), ['/no/map.yaml']),
    (('--poses', '/no/p.tum'), ['/no/p.tum']),
    (('--frames', '2'), ['--frames 2', 'at least 3']),
])
def test_what_cannot_be_is_refused(drive, tmp_path, capsys, options, words):
    out = tmp_path / 'calibration'
    assert main(['calibrate', str(drive), *options, '--out', str(out)]) == 1
    error = capsys.readouterr().err
    assert all(word in error for word in words), error
    assert not out.exists()


def test_a_bag_without_poses_names_them(drive, tmp_path, capsys):
    bag = rewritten(tmp_path / 'bag.mcap', [m for m in recorded(drive) if m[0] != '/ground_truth'])
    map_file, parameters = str(drive / 'map.yaml'), str(drive / 'params.yaml')
    assert main(['calibrate', str(bag), '--map', map_file, '--params', parameters]) == 1
    assert '--poses' in capsys.readouterr().err


def test_frames_that_do_not_agree_are_no_calibration(drive, tmp_path, capsys):
    """On the map of another place nothing agrees, and the message says what to check."""
    flat = cv2.imread(str(drive / 'map.png'), cv2.IMREAD_UNCHANGED)
    cv2.imwrite(str(tmp_path / 'other.png'), np.ascontiguousarray(flat[::-1, ::-1]))
    text = (drive / 'map.yaml').read_text().replace('map.png', 'other.png')
    (tmp_path / 'other.yaml').write_text(text)
    words = ['calibrate', str(drive), *FEW, '--frames', '3', '--map', str(tmp_path / 'other.yaml'),
             '--out', str(tmp_path / 'calibration')]
    assert main(words) == 1
    assert 'frames agree on a mounting pose' in capsys.readouterr().err

