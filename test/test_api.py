# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The public Python interface, as docs/api.md shows and promises it."""

from __future__ import annotations

import inspect
from pathlib import Path
import re
import subprocess
import sys

import cv2
import numpy as np
import pytest

import gip_localizer
from gip_localizer import Camera, draw_overlay, GipError, load_map, Localizer
from gip_localizer.io.camera_info_files import load_camera_info

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / 'docs' / 'api.md').read_text()
FRAME = ROOT / 'bags' / 'frame'
K = [[450.0, 0.0, 319.5], [0.0, 450.0, 179.5], [0.0, 0.0, 1.0]]


def block(kind: str) -> str:
    found = re.findall(rf'```{kind}\n(.*?)```', PAGE, re.DOTALL)
    assert len(found) == 1
    return found[0]


def test_the_lines_of_the_page_print_what_it_says(tmp_path):
    for name in ('bags', 'docs'):
        (tmp_path / name).symlink_to(ROOT / name)
    code = block('python')
    assert len(code.splitlines()) == 8
    done = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, capture_output=True,
                          text=True, timeout=120)
    assert done.stdout == block('text'), done.stderr
    assert cv2.imread(str(tmp_path / 'overlay.png')).shape == (360, 640, 3)


def test_the_import_alone_loads_nothing():
    code = 'import gip_localizer, sys; print("numpy" in sys.modules, dir(gip_localizer))'
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True,
                          timeout=60, check=True)
    assert done.stdout.startswith('False')
    assert all(name in done.stdout for name in gip_localizer.__all__)
    with pytest.raises(AttributeError, match='nothing'):
        gip_localizer.nothing  # noqa: B018


def test_the_page_names_everything_that_is_public():
    for name in gip_localizer.__all__:
        assert f'`{name}' in PAGE, name
    for name, _ in inspect.getmembers(Localizer, inspect.isfunction):
        if not name.startswith('_'):
            assert f'`.{name}(' in PAGE, name


@pytest.fixture(scope='module')
def road_map():
    return load_map(ROOT / 'bags' / 'demo' / 'map.yaml')


@pytest.fixture(scope='module')
def frame():
    return cv2.imread(str(FRAME / 'frame.jpg'), cv2.IMREAD_GRAYSCALE)


def camera():
    return Camera(640, 360, K, z=1.5, pitch=0.2618)


def test_colours_and_files_change_nothing(road_map, frame):
    read = Camera.from_file(FRAME / 'camera.yaml', z=1.5, pitch=0.2618)
    colour = np.dstack([frame, frame, frame, np.full_like(frame, 255)])
    found = [Localizer(road_map, device, start=(24.3, 6.1, 0.01)).localize(image, 1)
             for device, image in ((camera(), frame), (read, colour))]
    np.testing.assert_allclose(found[0].pose, found[1].pose, atol=1e-9)
    assert found[0].published
    assert found[0].covariance.shape == (3, 3)


def test_settings_reach_the_localizer_and_the_rest_is_kept(road_map, frame):
    localizer = Localizer(road_map, camera(), start=(24.3, 6.1, 0.01),
                          settings={'score.min_overlap': 0.6, 'initial_pose.set': True})
    localizer.start_at(24.1, 6.2, 0.0, sigma_xy=0.1)
    assert localizer.localize(frame, 1).published
    assert localizer.add_odometry(2, 0.0, 0.0, 0.0)
    assert not localizer.add_odometry(2, 0.0, 0.0, 0.0)
    assert localizer.localize(frame, 1).status == 'OUT_OF_ORDER'


def test_a_frame_without_a_pose_has_a_status_and_a_picture(road_map, frame):
    found = Localizer(road_map, camera(), start=(900.0, 0.0, 0.0)).localize(frame, 1)
    assert (found.status, found.pose) == ('OFF_MAP', None)
    assert draw_overlay(frame, found, camera(), road_map).shape == (360, 640, 3)


@pytest.mark.parametrize(('made', 'words'), [
    (lambda road, frame: Camera(640, 360, np.zeros((3, 3))), 'not calibrated'),
    (lambda road, frame: Camera(640, 360, K, focal=1.5), 'camera.focal'),
    (lambda road, frame: Camera(640, 360, K, z=-1.0), 'camera.z'),
    (lambda road, frame: Localizer(road, camera(), settings={'view.far': 3.0}), 'view.far'),
    (lambda road, frame: Localizer(road, camera()).localize(None, 1), 'cv2.imread'),
    (lambda road, frame: Localizer(road, camera()).localize(frame * 1.0, 1), 'float64'),
    (lambda road, frame: Localizer(road, camera()).localize(frame[None], 1), 'shape'),
    (lambda road, frame: load_map('none.yaml'), 'none.yaml'),
    (lambda road, frame: Localizer(road, camera(), start=(1.0, 2.0)), '(x, y, yaw)'),
    (lambda road, frame: Localizer(road, camera(), start='truth'), "'truth'"),
    (lambda road, frame: Localizer(road, camera()).start_at(1, 2, 0, sigma_xy=-1.0), '-1.0 m'),
])
def test_what_cannot_be_used_is_named(road_map, frame, made, words):
    with pytest.raises(GipError, match=re.escape(words)):
        made(road_map, frame)


MESSAGE = f"""
header: {{stamp: {{sec: 1, nanosec: 2}}, frame_id: cam}}
height: 360
width: 640
distortion_model: plumb_bob
d: [0.1, 0.0, 0.0, 0.0, 0.0]
k: {[value for row in K for value in row]}
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [450.0, 0.0, 319.5, 0.0, 0.0, 450.0, 179.5, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {{x_offset: 4, y_offset: 0, height: 300, width: 600, do_rectify: false}}
---
"""


def test_a_printed_message_is_a_calibration(tmp_path):
    path = tmp_path / 'camera.yaml'
    path.write_text(MESSAGE)
    info = load_camera_info(path)
    assert (info.width, info.height, info.roi.x_offset) == (640, 360, 4)
    assert info.d.tolist() == [0.1, 0.0, 0.0, 0.0, 0.0]
    assert Camera.from_file(path).model.width == 600


@pytest.mark.parametrize(('text', 'words'), [
    ('', 'expected image_width'), ('[1, 2]', 'expected image_width'), ('a: [', 'not valid YAML'),
    ('image_width: 640\nimage_height: 360\n', 'camera_matrix is missing'),
    (MESSAGE.replace('k: [450.0, ', 'k: ['), 'k has 8 numbers; expected 9'),
    (MESSAGE.replace('d: [0.1', 'd: [x'), 'd is '), (MESSAGE.replace('640', 'wide'), 'width is'),
])
def test_a_bad_calibration_file_is_named(tmp_path, text, words):
    path = tmp_path / 'camera.yaml'
    path.write_text(text)
    with pytest.raises(GipError, match=re.escape(words)) as error:
        load_camera_info(path)
    assert str(path) in str(error.value)
