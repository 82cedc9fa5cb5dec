# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip import`: folders of images, as data sets have them, become bags that are replayed."""

from __future__ import annotations

import math

import cv2
from drive_samples import replayed
import numpy as np
import pytest

from gip_localizer.cli import main
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.errors import GipError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.folder.poses import read_poses
from gip_localizer.io.folder.stamps import stamps_of
from gip_localizer.io.images import grey_image
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters import load_parameter_file

COUNT = 6
CAMERA = """image_width: 16
image_height: 12
camera_matrix: {rows: 3, cols: 3, data: [20.0, 0.0, 8.0, 0.0, 20.0, 6.0, 0.0, 0.0, 1.0]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0.0, 0.0, 0.0, 0.0, 0.0]}
"""
MOUNTED = ['--camera-pose', '0,0,1.5,0,0.26,0']
HELD = Extrinsics(1.0, 0.2, 1.65, 0.01, 0.1, -0.03)


def tum(rows):
    return ''.join(f'{t} {x} {y} 0 0 0 {math.sin(a / 2)} {math.cos(a / 2)}\n'
                   for t, x, y, a in rows)


@pytest.fixture
def folder(tmp_path):
    """Six tiny images at 10 Hz with everything that an import needs."""
    path = tmp_path / 'in'
    (path / 'image').mkdir(parents=True)
    for n in range(COUNT):
        picture = np.full((12, 16), 20 * n, np.uint8)
        cv2.imwrite(str(path / 'image' / f'f{n + 8}.png'), picture)  # f8, f9, f10 ...
    (path / 'times.txt').write_text(''.join(f'{10 + 0.1 * n:.1f}\n' for n in range(COUNT)))
    (path / 'camera.yaml').write_text(CAMERA)
    (path / 'poses.txt').write_text(tum((10 + 0.1 * n, n, 0.5 * n, 0.46) for n in range(COUNT)))
    return path


def imported(folder, tmp_path, *options):
    return main(['import', str(folder), '--out', str(tmp_path / 'out'), *options])


def test_the_bag_holds_images_stamps_calibration_and_poses(folder, tmp_path, capsys):
    assert imported(folder, tmp_path, *MOUNTED) == 0
    bag = Bag([tmp_path / 'out'])
    assert bag.notes == []
    assert {topic.name: topic.messages for topic in bag.topics} == {
        '/image': COUNT, '/camera_info': COUNT, '/ground_truth': COUNT, '/tf_static': 1}
    images = [bag.decode(message) for message in bag.messages(['/image'])]
    assert [int(grey_image(image)[0, 0]) for image in images] == [20 * n for n in range(COUNT)]
    assert [stamp_ns(image.header) for image in images] == [
        10_000_000_000 + 100_000_000 * n for n in range(COUNT)]
    parameters = load_parameter_file(tmp_path / 'out' / 'params.yaml')
    assert (parameters.camera.pitch, parameters.initial_pose.set) == (0.26, True)
    assert parameters.initial_pose.yaw == pytest.approx(0.46)
    assert '6 images' in capsys.readouterr().out


def test_it_replays_as_the_recording_that_it_is_made_of(drive, tmp_path, capsys):
    path, bag = tmp_path / 'in', Bag([drive])
    path.mkdir()
    stop = bag.start_ns + 350_000_000
    images = [bag.decode(message) for message in bag.messages(['/image'], 0, stop)]
    for image in images:
        name = f'{stamp_ns(image.header)}.png'
        cv2.imwrite(str(path / name), grey_image(image))
    info = bag.decode(next(bag.messages(['/camera_info'])))
    k = ','.join(str(info.k[i]) for i in (0, 4, 2, 5))
    truth = tmp_path / 'truth.tum'
    poses = [bag.decode(message) for message in bag.messages(['/ground_truth'], 0, stop)]
    truth.write_text(''.join(
        f'{stamp_ns(p.header) * 1e-9:.9f} {p.pose.position.x!r} {p.pose.position.y!r} 0 0 0 '
        f'{p.pose.orientation.z!r} {p.pose.orientation.w!r}\n' for p in poses))
    assert imported(path, tmp_path, '--k', k, '--poses', str(truth), '--params',
                    str(drive / 'params.yaml')) == 0
    assert 'named by their stamps' in capsys.readouterr().err
    options = ['--no-odometry', '--initial-pose', 'truth', '--duration', '0.35']
    found = [replayed(source, drive, tmp_path / f'run{n}', *options)
             for n, source in enumerate((drive, tmp_path / 'out'))]
    assert found[0]['published'] == found[1]['published'] == len(images)
    assert found[1]['rmse_xy_m'] == pytest.approx(found[0]['rmse_xy_m'], abs=1e-6)


def test_stamps_from_zero_are_shifted_and_a_rate_makes_them(folder, tmp_path, capsys):
    (folder / 'times.txt').unlink()
    (folder / 'poses.txt').write_text(tum((0.1 * n, n, 0.0, 0.0) for n in range(COUNT)))
    assert imported(folder, tmp_path, *MOUNTED, '--rate', '10') == 0
    bag = Bag([tmp_path / 'out'])
    stamps = [[stamp_ns(bag.decode(message).header) for message in bag.messages([topic])]
              for topic in ('/image', '/ground_truth')]
    assert stamps[0] == stamps[1] == [10**9 + 10**8 * n for n in range(COUNT)]
    assert '1 s are added to all' in capsys.readouterr().err


def test_images_alone_are_enough(folder, tmp_path, capsys):
    (folder / 'poses.txt').unlink()
    assert imported(folder, tmp_path, *MOUNTED) == 0
    assert 'there are no poses' in capsys.readouterr().err
    assert not load_parameter_file(tmp_path / 'out' / 'params.yaml').initial_pose.set


def changed(name, text):
    return lambda folder: (folder / name).write_text(text)


def two_sizes(folder):
    cv2.imwrite(str(folder / 'image' / 'f11.png'), np.zeros((12, 18), np.uint8))


def cut(folder):
    whole = (folder / 'image' / 'f12.png').read_bytes()
    (folder / 'image' / 'f12.png').write_bytes(whole[:40])


def second_camera(folder):
    (folder / 'rear').mkdir()
    cv2.imwrite(str(folder / 'rear' / 'a.png'), np.zeros((12, 16), np.uint8))


@pytest.mark.parametrize(('change', 'options', 'words'), [
    (lambda f: (f / 'times.txt').unlink(), [], ['no timestamps', '--rate']),
    (changed('times.txt', '1\n2\n'), [], ['times.txt has 2 stamps for 6 images']),
    (changed('times.txt', '1\n2\n2\n3\n4\n5\n'), [], ['f10.png', 'not after that of f9.png']),
    (changed('times.txt', '1\n2\nlate\n'), [], ['times.txt:3', 'late']),
    (changed('times.txt', '1 a.png\n'), [], ["'a.png'", '1 of 1 are not']),
    (two_sizes, [], ['two sizes', 'f8.png (16x12)', 'f11.png (18x12)']),
    (cut, [], ['f12.png']),
    (second_camera, [], ['image, rear', '--images']),
    (lambda f: (f / 'camera.yaml').unlink(), [], ['calibration', 'missing', '--k']),
    (changed('camera.yaml', CAMERA.replace('16', '640')), [], ['16x12', '640x12']),
    (changed('poses.txt', '10 1 2 0.3\n'), [], ['poses.txt:1', '2-D, stamp x y yaw']),
    (changed('poses.txt', '10 1 2\n'), [], ['without heading']),
    (changed('poses.txt', tum((10 + n, n, 3 * n, 0) for n in range(9))), [], ['hold no heading']),
    (changed('poses.txt', '10 0 0 0 0.7071 0 0 0.7071\n'), [], ['--poses-of camera']),
    (changed('poses.txt', '1 0 0 0 0 1 0 0 0 0 1 0\n' * 5), [], ['5 poses for 6 images']),
    (changed('poses.txt', '2 0 0 0 0 1 0 0 0 0 1 0\n' * 6), [], ['no rotation']),
    (lambda f: None, ['--images', 'none'], ['--images none']),
    (lambda f: None, ['--rate', '10', '--timestamps', 't.txt'], ['contradict']),
    (lambda f: None, ['--k', '1,2,3'], ['--k 1,2,3', '4 numbers']),
    (lambda f: None, ['--d', '0.1'], ['--d goes with --k']),
    (lambda f: None, ['--model', 'equidistant'], ['--model goes with --k']),
    (lambda f: None, ['--k', '9,9,8,6', '--model', 'foo'], ['--model foo', 'equidistant']),
    (lambda f: (f / 'times.txt').unlink(), ['--rate', '1e7'], ['--rate 1e+07', 'below 1e6']),
    (lambda f: None, ['--set', 'camera.z=-3'], ['camera.z']),
])
def test_what_cannot_be_imported_is_named_and_nothing_is_left(
    folder, tmp_path, capsys, change, options, words
):
    change(folder)
    assert imported(folder, tmp_path, *MOUNTED, *options) == 1
    error = capsys.readouterr().err
    for word in words:
        assert word in error
    assert [path.name for path in tmp_path.iterdir()] == ['in']


def test_where_the_camera_is_must_be_given(folder, tmp_path, capsys):
    assert imported(folder, tmp_path) == 1
    assert '--camera-pose' in capsys.readouterr().err
    assert main(['import', str(tmp_path / 'none'), *MOUNTED, '--out', str(tmp_path / 'o')]) == 1
    assert 'is no folder' in capsys.readouterr().err


def test_gaps_jumps_and_images_without_a_pose_are_named(tmp_path):
    path = tmp_path / 'p.txt'
    path.write_text(tum([(1, 0, 0, 0), (2, 1, 0, 0), (6, 5, 0, 0), (6.1, 90, 0, 0)]))
    notes = read_poses(path, [10**9 * n for n in (0, 1, 4, 6, 7)], HELD).notes
    assert any('gap from 2.00 to 6.00 s' in note for note in notes)
    assert any('jump by 85.0 m at 6.10 s' in note for note in notes)
    assert any('3 of 5 images have no pose' in note for note in notes)


def test_poses_of_the_camera_become_those_of_the_vehicle(tmp_path):
    path, stamps = tmp_path / 'p.txt', [10**9 * n for n in range(1, 6)]
    path.write_text(tum((n, 2 * n, 0.1 * n * n, 0.1 * n) for n in range(1, 6)))
    base = read_poses(path, stamps, HELD).T_map_base
    mounted = np.eye(4)
    mounted[:3, :3], mounted[:3, 3] = HELD.rotation(), HELD.position()
    first = np.linalg.inv(base[0] @ mounted) @ base @ mounted  # as KITTI has them
    path.write_text('\n'.join(' '.join(map(repr, map(float, T[:3].ravel()))) for T in first))
    found = read_poses(path, stamps, HELD)
    np.testing.assert_allclose(found.T_map_base, np.linalg.inv(base[0]) @ base, atol=1e-9)
    assert any('frame of its first image' in note for note in found.notes)


@pytest.mark.parametrize(('text', 'expected'), [
    ('1\n1.5\n', [10**9, 15 * 10**8]),
    ('#t\n1403636579763555584,b.png\n1403636579813555456,a.png\n',
     [1403636579763555584, 1403636579813555456]),
    ('stamp,file\n1700000000000 a.png\n1700000000100 b.png\n',
     [1700000000000 * 10**6, 1700000000100 * 10**6]),
    ('2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.067\n',
     [1317042145964389445, 1317042146067000000]),
])
def test_stamps_of_data_sets(tmp_path, text, expected):
    file = tmp_path / 'times.txt'
    file.write_text(text)
    images = [tmp_path / name for name in ('a.png', 'b.png')]
    pairs, _ = stamps_of(images, [tmp_path], file=None, rate=None)
    assert [stamp for stamp, _ in pairs] == expected
    if 'b.png' in text.splitlines()[1]:
        assert pairs[0][1].name == 'b.png'


def test_running_numbers_are_no_stamps(tmp_path):
    images = [tmp_path / f'{n:06d}.png' for n in range(3)]
    with pytest.raises(GipError, match='no timestamps'):
        stamps_of(images, [tmp_path], file=None, rate=None)
