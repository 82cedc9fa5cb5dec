# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip suggest`: the view of a calibration file or a bag, as YAML that can be pasted."""

from pathlib import Path

import cv2
import pytest

from gip_localizer.cli import main
from gip_localizer.parameters import load_parameter_file

DEMO = Path(__file__).parents[1] / 'bags' / 'demo'
CAMERA = """image_width: 640
image_height: 480
distortion_model: plumb_bob
camera_matrix: {rows: 3, cols: 3, data: [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1]}
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
ROBOT = ['--set', 'camera.z=0.35', '--set', 'camera.pitch=0.44']


@pytest.fixture
def camera_file(tmp_path):
    path = tmp_path / 'camera.yaml'
    path.write_text(CAMERA)
    return path


def test_the_output_is_a_parameter_file(camera_file, tmp_path, capsys):
    assert main(['suggest', str(camera_file), *ROBOT]) == 0
    said = capsys.readouterr().out
    (tmp_path / 'view.yaml').write_text(said)
    view = load_parameter_file(tmp_path / 'view.yaml').birdseye
    assert view.automatic == ()
    assert 0.2 < view.near < 0.5
    assert 2.0 < view.far < 3.0
    assert 'cells inside the image' in said
    assert '--map' in said


def test_a_bag_with_its_map_gives_a_standard_deviation_and_a_picture(tmp_path, capsys):
    out = tmp_path / 'view.png'
    assert main(['suggest', str(DEMO), '--map', str(DEMO / 'map.yaml'), '--out', str(out)]) == 0
    assert 'mm ahead' in capsys.readouterr().out
    assert cv2.imread(str(out)).shape[0] > 300
    assert main(['suggest', str(DEMO), '--out', str(out)]) == 1


@pytest.mark.parametrize(('args', 'words'), [
    (['--set', 'camera.pitch=-0.9'], 'sees no road'),
    (['--set', 'camera.z=-1.0'], 'camera.z'),
    (['--map', 'none.yaml'], 'none.yaml'),
    (['--out', 'view.txt'], 'view.txt'),
])
def test_bad_input_is_named(camera_file, capsys, args, words):
    assert main(['suggest', str(camera_file), *args]) == 1
    assert words in capsys.readouterr().err


def test_a_file_that_is_no_calibration_is_named(tmp_path, capsys):
    (tmp_path / 'x.yaml').write_text('a: 1\n')
    assert main(['suggest', str(tmp_path / 'x.yaml')]) == 1
    assert 'x.yaml' in capsys.readouterr().err
    assert main(['suggest', str(tmp_path / 'none.yaml')]) == 1
    assert 'none.yaml' in capsys.readouterr().err
