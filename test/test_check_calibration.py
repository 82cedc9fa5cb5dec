# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip check-calibration` on the demo bag, whose true pitch is 15 degrees."""

from __future__ import annotations

import math
from pathlib import Path
import re

import cv2
from drive_samples import recorded, rewritten
import numpy as np
import pytest

from gip_localizer.cli import main
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.io.cdr import jazzy
from gip_localizer.mapping.lane_lines import lane_lines, LaneLine, pitch_excess

BAG = Path(__file__).parents[1] / 'bags' / 'demo'
TRUE_PITCH = math.radians(15.0)
GRID = Grid(12.0, 4.0, 200, 160, 0.05)


def check(tmp_path, capsys, *words):
    code = main(['check-calibration', str(BAG), '--out', str(tmp_path / 'c.png'), *words])
    said = capsys.readouterr()
    found = re.search(r'estimated camera.pitch +([\d.]+)', said.out)
    return code, float(found.group(1)) if found else None, said


def test_the_true_pitch_passes(tmp_path, capsys):
    code, pitch, _ = check(tmp_path, capsys)
    assert code == 0
    assert pitch == pytest.approx(TRUE_PITCH, abs=math.radians(0.25))
    assert (tmp_path / 'c.png').stat().st_size > 10_000


@pytest.mark.parametrize('off_deg', [1.0, -1.0])
def test_a_pitch_off_by_a_degree_fails_and_is_told(tmp_path, capsys, off_deg):
    wrong = TRUE_PITCH + math.radians(off_deg)
    code, pitch, said = check(tmp_path, capsys, '--set', f'camera.pitch={wrong}')
    assert code == 1
    assert 'not parallel' in said.err
    assert f'camera.pitch too {"large" if off_deg > 0.0 else "small"} by' in said.out
    assert pitch == pytest.approx(TRUE_PITCH, abs=math.radians(0.3))


def test_a_view_without_two_lines_says_what_is_needed(tmp_path, capsys):
    code, pitch, said = check(tmp_path, capsys, '--set', 'birdseye.half_width=0.8')
    assert (code, pitch) == (1, None)
    assert 'two straight lane lines' in said.err


def test_a_picture_is_not_replaced_unasked(tmp_path, capsys):
    (tmp_path / 'c.png').write_text('mine')
    code, _, said = check(tmp_path, capsys)
    assert code == 1
    assert '--force' in said.err
    assert (tmp_path / 'c.png').read_text() == 'mine'


@pytest.mark.parametrize(('out', 'words'), [
    ('', 'is a folder'), ('c.xyz', "has the ending '.xyz'"), ('c', "has the ending ''"),
    ('file.txt/c.png', 'cannot be written'),
])
def test_a_picture_that_cannot_be_written_is_told(tmp_path, capsys, out, words):
    (tmp_path / 'file.txt').write_text('')
    code, _, said = check(tmp_path, capsys, '--out', str(tmp_path / out), '--force')
    assert code == 1
    assert words in said.err
    assert [path.name for path in tmp_path.iterdir()] == ['file.txt']


def damaged(tmp_path, change):
    """The demo bag with every fifth image changed (its bytes)."""
    pictures, messages = 0, []
    for topic, msgtype, log_ns, raw in recorded(BAG):
        if msgtype == 'sensor_msgs/msg/CompressedImage':
            pictures += 1
            if pictures % 5 == 0:
                message = jazzy().deserialize_cdr(raw, msgtype)
                message.data = change(message.data)
                raw = bytes(jazzy().serialize_cdr(message, msgtype))
        messages.append((topic, msgtype, log_ns, raw))
    return rewritten(tmp_path / 'bag.mcap', messages)


def half_size(data):
    picture = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE)
    return cv2.imencode('.jpg', picture[::2, ::2])[1].ravel()


@pytest.mark.parametrize(('change', 'words'), [
    (lambda data: data[:200], 'truncated'), (half_size, 'its CameraInfo is for'),
])
def test_images_that_cannot_be_used_are_counted_and_the_others_tell(
    tmp_path, capsys, change, words
):
    code = main(['check-calibration', str(damaged(tmp_path, change)),
                 '--params', str(BAG / 'params.yaml'), '--out', str(tmp_path / 'c.png')])
    said = capsys.readouterr()
    assert code == 0, said.err
    line, = (line for line in said.out.splitlines() if 'cannot be used' in line)
    assert ' 8 ' in line
    assert words in line


def painted(*lines):
    """A dark road with stripes of 12 cm: (offset, slope) each."""
    x, y = GRID.points()[:, 0], GRID.points()[:, 1]
    grey = 0.2 + 0.02 * np.random.default_rng(3).normal(size=len(x))
    for offset, slope in lines:
        grey[np.abs(y - offset - slope * x) < 0.06] = 0.8
    valid = np.ones(GRID.shape, bool)
    return View(grey.reshape(GRID.shape).astype(np.float32), valid.astype(np.float32), valid, GRID)


def test_lines_are_found_where_they_are_painted():
    wanted = [(1.6, 0.02), (-1.7, -0.03)]
    found = sorted(((line.offset, line.slope) for line in lane_lines(painted(*wanted), 0.0)),
                   reverse=True)
    assert np.allclose(found, wanted, atol=0.01)


def test_a_bare_road_has_no_lines():
    assert lane_lines(painted(), 0.0) == []


def test_slopes_that_grow_with_the_offset_tell_the_pitch():
    too_much, height = 0.01, 1.5
    lines = [LaneLine(y, 0.05 - too_much * y / height, 3.0, 12.0, 0.0) for y in (-3.0, 0.0, 3.0)]
    assert pitch_excess(lines, height) == pytest.approx(too_much)
    assert pitch_excess(lines[:1], height) is None
