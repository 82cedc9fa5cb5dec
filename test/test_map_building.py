# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip map`: a drive with known poses becomes a map that a second drive is localized on."""

from __future__ import annotations

import json
from pathlib import Path
import re

import cv2
from drive_samples import recorded, rewritten, ROUGH, SMALL
import numpy as np
import pytest

from gip_localizer.cli import main
from gip_localizer.core.map.accuracy import MapAccuracy
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import WHITE
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import choose_topics, TopicNames
from gip_localizer.io.bags.truth import read_truth
from gip_localizer.io.map_files import load_map
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import write_tum

SEEN_WELL = 0.02  # noise of a cell, grey


def build(bag: Path, out: Path, *options: str, check: str = '--no-pose-check') -> RasterMap:
    assert main(['map', str(bag), '--out', str(out), *options, *check.split()]) == 0
    return load_map(out)


def truth_of(folder: Path) -> Trajectory:
    bag = Bag([folder])
    truth, _ = read_truth(bag, choose_topics(bag, TopicNames()), 'map')
    assert truth is not None
    return truth


@pytest.fixture(scope='module')
def built(drive, tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp('map') / 'road.yaml'
    build(drive, out)
    return out


class Compared:
    """A built map and the world it shows, on the same cells, in the map's grey levels."""

    def __init__(self, built: Path, world: Path) -> None:
        self.map, whole = load_map(built), load_map(world)
        (rows, cols), r = self.map.grey.shape, self.map.resolution
        shift = np.array([self.map.origin.x - whole.origin.x, self.map.origin.y - whole.origin.y])
        col, low = np.round(shift / r).astype(int)
        assert shift == pytest.approx(np.array([col, low]) * r, abs=1e-9)
        row = whole.grey.shape[0] - low - rows
        world_grey = whole.grey[row:row + rows, col:col + cols] / WHITE[whole.grey.dtype]
        self.grey, self.noise = self.map.grey / 65535.0, self.map.noise / 65535.0
        self.valid = self.map.valid
        self.well = self.valid & (self.noise < SEEN_WELL)
        weight = 1.0 / self.noise[self.well]
        line = np.column_stack([world_grey[self.well], np.ones(self.well.sum())])
        gain, offset = np.linalg.lstsq(line * weight[:, None], self.grey[self.well] * weight,
                                       rcond=None)[0]
        self.world = gain * world_grey + offset


@pytest.fixture(scope='module')
def compared(built, drive) -> Compared:
    return Compared(built, drive / 'map.yaml')


def test_the_map_shows_the_road(compared):
    well = compared.well
    assert well.mean() > 0.3
    assert np.corrcoef(compared.world[well], compared.grey[well])[0, 1] > 0.985


def test_the_map_lies_where_the_road_lies(compared):
    """Below a fiftieth of a cell: nothing is drawn half a cell aside."""
    inside = cv2.erode(compared.well.astype(np.uint8), np.ones((7, 7))) > 0
    smooth, grey = (cv2.GaussianBlur(np.where(compared.valid, k, 0.0), (0, 0), 1.0)
                    for k in (compared.world, compared.grey))
    down, right = np.gradient(smooth)
    terms = np.column_stack([smooth[inside], np.ones(inside.sum()), right[inside], down[inside]])
    gain, _, x, y = np.linalg.lstsq(terms, grey[inside], rcond=None)[0]
    assert np.hypot(x, y) / gain < 0.05


def test_the_noise_of_the_cells_is_honest(compared):
    squares = ((compared.grey - compared.world) / compared.noise)[compared.well] ** 2
    assert 0.5 < squares.mean() < 2.0
    worse = compared.noise > np.median(compared.noise[compared.well])
    error = np.abs(compared.grey - compared.world)
    assert error[compared.well & worse].mean() > 1.3 * error[compared.well & ~worse].mean()


def test_brightness_does_not_drift_along_the_drive(compared):
    error = compared.grey - compared.world
    columns = np.array_split(np.arange(error.shape[1]), 5)
    levels = [error[:, c][compared.well[:, c]].mean() for c in columns
              if compared.well[:, c].sum() > 500]
    assert np.ptp(levels) < 0.012


def test_where_nothing_was_seen_the_map_is_transparent(compared):
    valid = compared.valid
    assert 0.2 < valid.mean() < 1.0
    assert valid[0].any()
    assert valid[-1].any()
    assert valid[:, 0].any()
    assert valid[:, -1].any()
    assert not compared.grey[~valid].any()
    assert compared.noise[~valid].min() == 1.0


def test_another_drive_is_localized_on_the_map(built, tmp_path):
    other = tmp_path / 'other'
    assert main(['simulate', '--seconds', '1.5', '--seed', '8', '--set', 'drive.start=2.3',
                 '--set', 'sensor.gain=0.8', '--out', str(other), *SMALL]) == 0
    assert main(['replay', str(other), '--map', str(built), '--out', str(tmp_path / 'r')]) == 0
    metrics = json.loads((tmp_path / 'r' / 'metrics.json').read_text())
    assert metrics['published'] == metrics['frames'] == 15
    assert metrics['wrong_published'] == 0
    assert metrics['rmse_xy_m'] < 0.01


def test_the_same_bag_gives_the_same_bytes(built, drive, tmp_path):
    build(drive, tmp_path / 'road.yaml')
    for name in ('road.yaml', 'road.png', 'road_noise.png'):
        assert (tmp_path / name).read_bytes() == (built.parent / name).read_bytes()
    assert len(list(tmp_path.iterdir())) == 3


def test_poses_of_a_file_are_interpolated(built, drive, tmp_path):
    truth = truth_of(drive)
    between = (truth.stamps_ns[1:] + truth.stamps_ns[:-1]) // 2
    write_tum(tmp_path / 'p.tum', Trajectory(between, truth.at(between)))
    raster = build(drive, tmp_path / 'road.yaml', '--poses', str(tmp_path / 'p.tum'))
    whole = load_map(built)
    assert raster.grey.size <= whole.grey.size
    assert abs(np.median(raster.grey[raster.valid]) - np.median(whole.grey[whole.valid])) < 2000


def test_gaps_between_poses_are_told(drive, tmp_path, capsys):
    truth = truth_of(drive)
    kept = np.r_[0:8, 15:25]
    write_tum(tmp_path / 'p.tum', Trajectory(truth.stamps_ns[kept], truth.poses[kept]))
    build(drive, tmp_path / 'road.yaml', '--poses', str(tmp_path / 'p.tum'))
    assert re.search(r'skipped: without a pose +7  ', capsys.readouterr().out)


def test_part_of_the_drive_in_other_cells(drive, tmp_path, capsys):
    raster = build(drive, tmp_path / 'a.yaml', '--every', '2', '--start', '0.5', '--duration',
                   '1.0', '--resolution', '0.1', '--set', 'birdseye.far=8')
    said, noted = capsys.readouterr()
    assert re.search(r'frames used +5\b', said)
    assert re.search(r'road used, farthest ahead +8\.00', said)
    assert 'the map is made of road up to' not in noted
    assert raster.resolution == 0.1
    assert raster.origin.yaw == 0.0
    assert (raster.origin.x / 0.1) == pytest.approx(round(raster.origin.x / 0.1), abs=1e-6)


def test_road_that_is_too_coarse_for_the_cells_is_named(drive, tmp_path, capsys):
    build(drive, tmp_path / 'a.yaml', '--duration', '0.05', '--resolution', '0.02')
    assert 'road up to 5.0 m ahead, though the view reaches 11.5 m' in capsys.readouterr().err


def test_a_vehicle_that_stands_adds_nothing(drive, tmp_path, capsys):
    truth = truth_of(drive)
    truth.poses[10:] = truth.poses[9]
    write_tum(tmp_path / 'p.tum', truth)
    build(drive, tmp_path / 'road.yaml', '--poses', str(tmp_path / 'p.tum'))
    assert re.search(r'skipped: hardly moved +15  ', capsys.readouterr().out)


def test_a_compressed_turned_drive_through_a_mask(tmp_path, capsys):
    folder = tmp_path / 'drive'
    assert main(['simulate', '--scenario', 'distorted', '--transport', 'jpeg', '--seconds', '1',
                 '--out', str(folder), *SMALL, *ROUGH]) == 0
    mask = np.full((360, 640), 255, np.uint8)
    mask[:, :320] = 0
    cv2.imwrite(str(tmp_path / 'mask.png'), mask)
    whole = build(folder, tmp_path / 'whole.yaml')
    half = build(folder, tmp_path / 'half.yaml', '--set', f'mask_file={tmp_path / "mask.png"}')
    assert 0.3 < half.valid.sum() / whole.valid.sum() < 0.7
    world = load_map(folder / 'map.yaml')
    rows, cols = np.nonzero(whole.valid & (whole.noise < SEEN_WELL * 65535))
    grey, known = world.sample(whole.to_map(np.column_stack([rows, cols])))
    assert np.corrcoef(grey[known], whole.grey[rows, cols][known])[0, 1] > 0.96


def test_the_poses_are_compared_with_the_frames_and_the_map_states_their_error(
    drive, tmp_path, capsys
):
    truth = truth_of(drive)
    rng = np.random.default_rng(5)
    rough = cv2.GaussianBlur(rng.normal(size=truth.poses.shape), (1, 0), 0.1, sigmaY=4.0)
    rough *= np.array([0.02, 0.02, 0.002]) / rough.std(axis=0)
    write_tum(tmp_path / 'p.tum', Trajectory(truth.stamps_ns, truth.poses + rough))
    raster = build(drive, tmp_path / 'road.yaml', '--poses', str(tmp_path / 'p.tum'), check='')
    assert 0.005 < raster.accuracy.sigma_xy < 0.06
    assert 0.0005 < raster.accuracy.sigma_yaw < 0.006
    said = capsys.readouterr().out
    assert re.search(r'pairs of frames compared +\d+ of \d+', said)
    assert re.search(r'sigma_xy of the map\) +\d+\.\d  mm', said)


def test_poses_that_could_not_be_compared_are_named(drive, tmp_path, capsys):
    raster = build(drive, tmp_path / 'road.yaml', '--duration', '0.15', check='')
    assert raster.accuracy == MapAccuracy()
    assert 'the error of the poses is not known' in capsys.readouterr().err
    build(drive, tmp_path / 'two.yaml', '--every', '8')
    assert 'the poses were not compared' in capsys.readouterr().err


def refused(capsys, *words: str) -> str:
    capsys.readouterr()
    assert main(['map', *words]) == 1
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith('gip: ')
    return error


@pytest.mark.parametrize(('options', 'words'), [
    (['--truth', '/gps'], ['/gps', '/ground_truth']),
    (['--image-topic', '/cam'], ['/cam', '/image']),
    (['--poses', '/no/p.tum'], ['/no/p.tum']),
    (['--resolution', '0'], ['--resolution 0', 'from 0.002']),
    (['--resolution', 'nan'], ['--resolution nan']),
    (['--every', '0'], ['--every 0']),
    (['--max-gap', '-1'], ['--max-gap -1']),
    (['--start', '99'], ['no image', '--start']),
    (['--set', 'camera.pitch=-0.9'], ['no road in view']),
    (['--set', 'birdseye.near=20', '--set', 'birdseye.far=30'], ['--resolution']),
    (['--params', '/no/params.yaml'], ['/no/params.yaml']),
    (['--set', 'mask_file=/no/mask.png'], ['/no/mask.png']),
])
def test_options_that_cannot_be(drive, tmp_path, capsys, options, words):
    error = refused(capsys, str(drive), '--out', str(tmp_path / 'road.yaml'), *options)
    for word in words:
        assert word in error
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(('content', 'words'), [
    ('', ['holds no pose']), ('# only a comment\n', ['holds no pose']),
    ('x\n', ['columns, expected 8']), ('1 2 3 4 5 6 7 8\n', ['quaternion']),
    ('1 0 0 0 0 0 0 1\n2 1 0 0 0 0 0 1\n', ['from 1.000 to 2.000 s', 'one clock']),
])
def test_pose_files_that_do_not_serve(drive, tmp_path, capsys, content, words):
    (tmp_path / 'p.tum').write_text(content)
    error = refused(capsys, str(drive), '--out', str(tmp_path / 'road.yaml'), '--poses',
                    str(tmp_path / 'p.tum'))
    for word in words:
        assert word in error
    assert [path.name for path in tmp_path.iterdir()] == ['p.tum']


@pytest.mark.parametrize(('without', 'words'), [
    ('/ground_truth', '--poses'), ('/image', 'no sensor_msgs/msg/Image'),
    ('/camera_info', 'CameraInfo'),
])
def test_bags_that_lack_something(drive, tmp_path, capsys, without, words):
    bag = rewritten(tmp_path / 'bag.mcap', [m for m in recorded(drive) if m[0] != without])
    assert words in refused(capsys, str(bag), '--out', str(tmp_path / 'out' / 'road.yaml'))
    assert [path.name for path in tmp_path.iterdir()] == ['bag.mcap']


@pytest.mark.parametrize('name', ['road.yaml', 'road.png', 'road_noise.png'])
def test_a_map_is_not_replaced_unasked(drive, tmp_path, capsys, name):
    (tmp_path / name).write_text('mine')
    assert '--force' in refused(capsys, str(drive), '--out', str(tmp_path / 'road.yaml'))
    assert (tmp_path / name).read_text() == 'mine'
    build(drive, tmp_path / 'road.yaml', '--force', '--every', '8')
