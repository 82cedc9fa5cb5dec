# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's experiment on rendered frames, and the methods that it is compared with."""

import csv
import math

import numpy as np
import pytest
from scipy.stats import binom

from gip_localizer.cli import main
from gip_localizer.core.birdseye.rectifier import Rectifier
from gip_localizer.core.pose import Pose2
from gip_localizer.paper.baseline_comparison import METHODS, run_beyond, TASKS
from gip_localizer.paper.baselines import (
    BaselineInput,
    ecc,
    ECC_CELL_M,
    ORB_CELL_M,
    orb_homography,
    PHASE_CELL_M,
    phase_correlation,
)
from gip_localizer.paper.geometry import PaperCamera
from gip_localizer.paper.image_experiment import run_pipeline
from gip_localizer.paper.pixel_camera import (
    paper_squares,
    pixel_camera,
    pixel_focal,
    square_birdseye,
    tile_world,
)
from gip_localizer.paper.squares import visible_squares
from gip_localizer.parameters import Birdseye
from gip_localizer.synthetic.renderer import Renderer

CAMERA = PaperCamera()


@pytest.fixture(scope='module')
def rectifier():
    return Rectifier(pixel_camera(CAMERA), square_birdseye(CAMERA))


def test_the_camera_sees_the_66_squares_whole(rectifier):
    chosen = paper_squares(visible_squares(CAMERA), rectifier.grid)
    assert chosen.sum() == 66
    assert rectifier.valid[chosen].all()
    assert chosen.sum(axis=1).tolist() == [13, 11, 9, 9, 7, 7, 5, 5]


def test_measured_footprints_are_the_closed_form(rectifier):
    squares = visible_squares(CAMERA)
    scale = (pixel_focal(CAMERA) / CAMERA.focal_length) ** 2
    closed = scale * CAMERA.area_constant * squares.row_gramian
    middle = rectifier.footprint[::-1, rectifier.grid.cols // 2]
    np.testing.assert_allclose(middle, closed, rtol=1e-3)


@pytest.fixture(scope='module')
def measured():
    return run_pipeline(CAMERA, 11, amplitudes=(1.0, 3.0), trials=200)


def test_images_err_as_the_theory_says(measured):
    for point in measured:
        if point.rectifier == 'footprint mean':
            low, high = binom.ppf([5e-4, 1 - 5e-4], point.trials, point.theory)
            assert low <= point.errors <= high


def test_a_point_sample_is_far_from_the_theory(measured):
    worst = [p for p in measured if p.amplitude == 3.0 and p.rectifier == 'point sample']
    assert all(p.rate > 3.0 * p.theory and not p.agrees for p in worst)


def test_pipeline_repeats_with_its_seed():
    runs = [run_pipeline(CAMERA, 5, amplitudes=(1.0,), trials=5) for _ in range(2)]
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ('peer', 'cell', 'truth'),
    [
        (orb_homography, ORB_CELL_M, Pose2(0.31, -0.22, 0.07)),
        (phase_correlation, PHASE_CELL_M, Pose2(0.31, -0.22, math.radians(4.0))),
        (ecc, ECC_CELL_M, Pose2(0.03, -0.02, 0.02)),
    ],
)
def test_peers_find_a_clear_place(peer, cell, truth):
    view = square_birdseye(CAMERA)
    camera = pixel_camera(CAMERA)
    world = tile_world(CAMERA, size=10.0, resolution=0.01, seed=2).fine
    prior = Pose2(5.0, 4.0, 0.6)
    image = Renderer(world, camera).render(prior @ truth)
    birdseye = Birdseye(view.near, view.far, view.half_width, cell)
    yaws = np.radians(np.arange(-10.0, 11.0, 2.0))
    scene = BaselineInput(Rectifier(camera, birdseye).rectify(image), world, prior, 0.6, yaws)
    found = peer(scene)
    assert found is not None
    assert math.hypot(found.x - truth.x, found.y - truth.y) < 0.1  # half a tile
    assert found.yaw == pytest.approx(truth.yaw, abs=0.05)


def test_beyond_counts_every_method_at_every_task():
    points = run_beyond(CAMERA, 0, amplitudes=(1.0, 1000.0), trials=2)
    assert len(points) == len(TASKS) * len(METHODS) * 2
    rate = {(p.task, p.amplitude, p.method): p.rate for p in points}
    for task in TASKS:
        assert rate[task.name, 1000.0, 'normalized generalized'] == 1.0
        assert rate[task.name, 1.0, 'ORB + homography'] == 0.0


def test_full_writes_both_tables_and_figures(tmp_path, capsys):
    out = tmp_path / 'out'
    args = ['paper', '--samples', '5', '--full', '--trials', '1', '--out', str(out)]
    assert main(args) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        'beyond.csv', 'beyond.png', 'beyond.svg', 'curves.csv', 'figure.png', 'figure.svg',
        'pipeline.csv', 'pipeline.png', 'pipeline.svg',
    ]
    with (out / 'pipeline.csv').open(encoding='utf-8') as file:
        rows = list(csv.DictReader(file))
    assert {row['trials'] for row in rows} == {'1'}
    assert len({row['amplitude'] for row in rows}) >= 8
    assert 'images agree with theory' in capsys.readouterr().out


@pytest.mark.parametrize('args', [['--trials', '0'], ['--full', '--height', '50']])
def test_bad_input_of_full(tmp_path, capsys, args):
    assert main(['paper', '--samples', '5', '--out', str(tmp_path / 'out'), *args]) == 1
    assert capsys.readouterr().err.count('\n') == 1
    assert list(tmp_path.iterdir()) == []
