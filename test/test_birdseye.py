# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from camera_samples import car_camera, HELD, make_camera, paper_camera
import numpy as np
import pytest
from scipy import sparse

from gip_localizer.core.birdseye.rectifier import make_grid, Rectifier
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye

LAW = (0.85, 1.1)  # of the variance of block means times ΣÃ/σ²; 1 for footprints of whole pixels
BLOCK_PX = 100.0
UNIFORM_VARIANCE = (256**2 - 1) / 12 / 255**2  # of uint8 noise, as shares of full scale
FRAMES = 250  # a block's variance is known to 9 %, the median of a band much better
CAMERAS = {
    'paper, 20 cm squares': (paper_camera, Birdseye(0.4, 2.0, 1.4, 0.2)),
    'paper, 2 cm cells': (paper_camera, Birdseye(0.4, 2.0, 1.4, 0.02)),
    'car': (car_camera, Birdseye(3.0, 14.0, 4.0, 0.05)),
    'car, plumb_bob': (lambda: car_camera('plumb_bob'), Birdseye(3.0, 14.0, 4.0, 0.05)),
    'car, equidistant': (lambda: car_camera('equidistant'), Birdseye(3.0, 14.0, 4.0, 0.05)),
}


def square_blocks(footprint: np.ndarray) -> list[tuple[slice, slice]]:
    """Tile the view, near to far, with squares of cells whose footprints reach BLOCK_PX."""
    blocks, end = [], footprint.shape[0]
    while end > 0:
        side = next((k for k in range(1, end + 1) if _reaches(footprint[end - k : end], k)), None)
        if side is None:
            end -= 1
            continue
        blocks += [
            (slice(end - side, end), slice(c, c + side))
            for c in range(0, footprint.shape[1] - side + 1, side)
            if _whole(footprint[end - side : end, c : c + side])
        ]
        end -= side
    return blocks


def _whole(part: np.ndarray) -> bool:
    return bool((part > 0.0).all()) and float(part.sum()) >= BLOCK_PX


def _reaches(strip: np.ndarray, side: int) -> bool:
    parts = [strip[:, c : c + side] for c in range(0, strip.shape[1] - side + 1, side)]
    sums = [p.sum() for p in parts if (p > 0.0).all()]
    return bool(sums) and float(np.median(sums)) >= 1.05 * BLOCK_PX


def block_means(rectifier: Rectifier, blocks: list) -> tuple[sparse.csr_matrix, np.ndarray]:
    """Matrix (blocks, cells) of footprint-weighted means, and ΣÃ (blocks,)."""
    footprint = rectifier.footprint.astype(float)
    label = np.full(footprint.shape, -1)
    for number, block in enumerate(blocks):
        label[block] = number
    cells = np.flatnonzero(label.ravel() >= 0)
    weights = sparse.csr_matrix(
        (footprint.ravel()[cells], (label.ravel()[cells], cells)),
        shape=(len(blocks), footprint.size),
    )
    total = np.asarray(weights.sum(axis=1)).ravel()
    return sparse.diags(1.0 / total) @ weights, total


@pytest.mark.parametrize('name', CAMERAS)
def test_white_noise_averages_out_as_the_footprint_says(name):
    make, birdseye = CAMERAS[name]
    camera = make()
    rectifier = Rectifier(camera, birdseye)
    blocks = square_blocks(rectifier.footprint)
    means, total = block_means(rectifier, blocks)
    rng = np.random.default_rng(7)
    squares = np.zeros(len(blocks))
    for _ in range(FRAMES):
        view = rectifier.rectify(rng.integers(0, 256, (camera.height, camera.width), np.uint8))
        squares += (means @ (view.patch.ravel().astype(float) - 0.5)) ** 2
    ratio = squares / FRAMES * total / UNIFORM_VARIANCE
    rows = np.array([0.5 * (block[0].start + block[0].stop) for block in blocks])
    band = np.floor(birdseye.far - rows * birdseye.resolution).astype(int)
    medians = {int(b): float(np.median(ratio[band == b])) for b in np.unique(band)}
    # blocks lie over the whole view, not only where it is easy
    assert len(medians) >= math.floor(birdseye.far - birdseye.near)
    assert all(LAW[0] <= median <= LAW[1] for median in medians.values()), medians


def test_a_cell_is_the_mean_over_its_footprint_not_a_sample():
    # A pattern that alternates from pixel to pixel averages to its mean, wherever it is sampled.
    camera = make_camera()
    rectifier = Rectifier(camera, Birdseye(3.0, 9.0, 2.0, 0.2))
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    view = rectifier.rectify((((u + v) % 2) * 255).astype(np.uint8))
    near = view.valid & (view.footprint > 100.0)
    assert near.sum() > 50
    np.testing.assert_allclose(view.patch[near], 0.5, atol=0.02)


@pytest.mark.parametrize('lens', ['none', 'plumb_bob', 'equidistant'])
def test_a_scene_that_is_linear_on_the_road_comes_back(lens):
    camera = make_camera(lens)
    rectifier = Rectifier(camera, Birdseye(3.0, 9.0, 2.0, 0.1))
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    xy, on_road = camera.road_points(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    scene = np.where(on_road, 0.04 * xy[:, 0] + 0.03 * xy[:, 1] + 0.2, 0.0)
    view = rectifier.rectify(scene.reshape(u.shape).astype(np.float32))
    x, y = (k.reshape(view.patch.shape) for k in view.grid.points().T)
    expected = 0.04 * x + 0.03 * y + 0.2
    # a far cell borrows from pixels that reach beyond it: a small share of a cell
    np.testing.assert_allclose(view.patch[view.valid], expected[view.valid], atol=0.04 * 0.05)


@pytest.mark.parametrize(('dtype', 'white'), [
    (np.uint8, 255), (np.uint16, 65535), (np.float32, 1.0),
])
def test_full_scale_is_one_in_every_depth(dtype, white):
    rectifier = Rectifier(make_camera(), Birdseye(3.0, 9.0, 2.0, 0.1))
    view = rectifier.rectify(np.full((360, 640), white, dtype))
    np.testing.assert_allclose(view.patch[view.valid], 1.0, rtol=1e-5)
    assert view.patch.dtype == np.float32
    assert not view.patch[~view.valid].any()


def test_row_padding_and_strides_do_not_matter():
    rectifier = Rectifier(make_camera(), Birdseye(3.0, 9.0, 2.0, 0.1))
    wide = np.random.default_rng(1).integers(0, 256, (360, 700), np.uint8)
    padded = wide[:, :640]
    whole = np.ascontiguousarray(padded)
    np.testing.assert_array_equal(rectifier.rectify(padded).patch, rectifier.rectify(whole).patch)


def test_a_view_beyond_the_image_has_invalid_cells_and_no_nan():
    rectifier = Rectifier(make_camera(), Birdseye(-2.0, 30.0, 10.0, 0.2))
    view = rectifier.rectify(np.full((360, 640), 90, np.uint8))
    assert 0 < view.valid.sum() < view.valid.size
    assert np.isfinite(view.patch).all()
    assert not view.footprint[~view.valid].any()
    behind = view.grid.points()[:, 0].reshape(view.valid.shape) < HELD.x
    assert not view.valid[behind].any()


@pytest.mark.parametrize(('held', 'word'), [
    (Extrinsics(z=1.5, pitch=-1.0), 'sees no road at all'),
    (Extrinsics(z=1.5, pitch=-0.45), 'no road in view'),
    (Extrinsics(z=1.5, pitch=-0.3, roll=math.pi), 'no road in view'),
    (Extrinsics(z=1.5, pitch=0.3, yaw=math.pi), 'no road in view'),
    (Extrinsics(z=60.0, pitch=0.26), 'correct the extrinsics'),
])
def test_a_camera_without_road_in_view_is_refused_with_its_reason(held, word):
    with pytest.raises(CalibrationError, match=word):
        Rectifier(make_camera(held=held), Birdseye(2.5, 12.5, 4.0, 0.05))


def test_a_level_camera_high_enough_sees_road():
    rectifier = Rectifier(make_camera(held=Extrinsics(z=1.5)), Birdseye(5.0, 12.0, 2.0, 0.1))
    assert rectifier.valid.mean() > 0.5


@pytest.mark.parametrize(('birdseye', 'shape'), [
    (Birdseye(2.5, 12.5, 4.0, 0.05), (200, 160)),
    (Birdseye(0.4, 2.0, 1.4, 0.2), (8, 14)),
    (Birdseye(1.0, 2.02, 0.5, 0.1), (10, 10)),
])
def test_the_grid_starts_at_the_near_edge_and_is_centred(birdseye, shape):
    grid = make_grid(birdseye)
    assert grid.shape == shape
    assert grid.far - grid.rows * grid.resolution == pytest.approx(birdseye.near)
    assert grid.left == pytest.approx(0.5 * grid.cols * grid.resolution)


def test_the_pixel_blur_keeps_flat_roads_flat_and_mixes_far_cells_more():
    rectifier = Rectifier(make_camera(), Birdseye(3.0, 12.0, 2.0, 0.05))
    blur = rectifier.pixel_blur
    np.testing.assert_allclose(np.asarray(blur.sum(axis=1)).ravel(), 1.0, rtol=1e-5)
    own = blur.diagonal()
    x = rectifier.grid.points()[rectifier.valid.ravel()][:, 0]
    assert np.median(own[x < 4.0]) > 2.0 * np.median(own[x > 11.0])
