# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The parts of `gip map`: drawing, sums, exposure, shading and noise of cells."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.mapping import tiles as tiled_sums
from gip_localizer.mapping.exposure import fit_exposure
from gip_localizer.mapping.map_builder import MapBuilder
from gip_localizer.mapping.splatting import draw
from gip_localizer.mapping.tiles import Box, overlap, TiledSums
from gip_localizer.mapping.vignetting import CommonCells, fit_vignetting, Vignetting

GRID = Grid(4.0, 2.0, 160, 160, 0.025)
R = 0.05
POSES = [Pose2(x, y, yaw) for x in (0.0, 0.0125, 3.031) for y in (-0.0125, 0.02)
         for yaw in (0.0, 0.7, -2.5)]


def ramp(pose: Pose2):
    """A view of a plane that rises by 0.05 a metre along x and 0.03 along y."""
    return (pose.transform(GRID.points()) @ np.array([0.05, 0.03]) + 0.3).reshape(GRID.shape)


def view_of(grey) -> View:
    shape = GRID.shape
    return View(grey.astype(np.float32), np.full(shape, 2.0, np.float32), np.ones(shape, bool),
                GRID)


@pytest.mark.parametrize('pose', POSES)
def test_nothing_is_drawn_to_one_side_at_any_phase(pose):
    drawn = draw([ramp(pose)], np.ones(GRID.shape), GRID, pose, R)
    row, col = np.nonzero(drawn.weight)
    x, y = (col + drawn.box.col + 0.5) * R, (row + drawn.box.row + 0.5) * R
    middle = drawn.weight[row, col] > 3.5  # not at the rim
    error = (drawn.layers[0, row, col] - (0.3 + 0.05 * x + 0.03 * y))[middle]
    assert np.abs(error.mean()) < 0.02 * R * 0.05
    assert np.abs(error).max() < 0.3 * R * 0.05
    assert drawn.weight.sum() <= GRID.rows * GRID.cols + 1e-6


def test_a_frame_without_weight_draws_nothing():
    drawn = draw([ramp(POSES[0])], np.zeros(GRID.shape), GRID, POSES[0], R)
    assert drawn.weight.size == 0
    assert not MapBuilder(R).add(view_of(ramp(POSES[0])), np.zeros(GRID.shape), POSES[0])


def test_sums_are_the_same_wherever_tiles_meet():
    sums, rng = TiledSums(2), np.random.default_rng(1)
    whole = np.zeros((2, 600, 600))
    for _ in range(8):
        row, col = (int(k) for k in rng.integers(-250, 100, 2))
        part = rng.random((2, 150, 200))
        sums.add(Box(row, col, 150, 200), part)
        whole[:, row + 300:row + 450, col + 300:col + 500] += part
    assert np.array_equal(sums.window(Box(-300, -300, 600, 600)), whole)
    box = sums.bounds()
    assert sums.window(box).sum() == pytest.approx(whole.sum())


def test_a_map_that_grows_too_large_is_told(monkeypatch):
    builder = MapBuilder(R)
    view, weight = view_of(ramp(POSES[0])), np.full(GRID.shape, 1e4)
    assert builder.add(view, weight, Pose2(0.0, 0.0, 0.0))
    with pytest.raises(MapError, match='--resolution'):
        builder.add(view, weight, Pose2(1e5, 1e5, 0.0))
    monkeypatch.setattr(tiled_sums, 'MOST_CELLS', 60_000)
    with pytest.raises(MapError, match='at most 0 million'):
        builder.add(view, weight, Pose2(30.0, 0.0, 0.0))


def test_a_road_brighter_than_the_first_frame_allows_is_scaled_and_not_cut_off():
    builder = MapBuilder(R)
    dark, bright = ramp(POSES[0]), 2.5 * ramp(POSES[0])
    weight = np.full(GRID.shape, 1e4)
    builder.add(view_of(0.4 * dark), weight, POSES[0])
    plain = builder.map()
    assert builder.scale == 1.0
    builder = MapBuilder(R)
    builder.add(view_of(bright), weight, POSES[0])
    scaled_map = builder.map()
    grey, noise = (np.asarray(part) / 65535.0 for part in (scaled_map.grey, scaled_map.noise))
    assert builder.scale < 1.0
    assert np.mean(grey >= 1.0) < 0.002
    assert np.corrcoef(grey[plain.valid], plain.grey[plain.valid])[0, 1] > 0.999
    assert np.median(noise[plain.valid]) == pytest.approx(
        builder.scale * np.median(plain.noise[plain.valid]) / 65535.0, rel=0.3
    )


def test_boxes_apart_share_nothing():
    here, there = overlap(Box(0, 0, 4, 4), Box(10, 2, 3, 3))
    assert np.zeros((4, 4))[here].size == np.zeros((3, 3))[there].size == 0


@pytest.mark.parametrize('gain', [0.3, 1.0, 2.0])
def test_noise_of_the_map_does_not_lower_the_gain(gain):
    rng = np.random.default_rng(2)
    road, count = 0.4 + 0.1 * rng.standard_normal(4000), 4000
    sigma = 0.05
    value = gain * road + 0.03 + sigma * gain * rng.standard_normal(count)
    reference = road + sigma * rng.standard_normal(count)
    value[:300] = 0.9  # a car
    noise_sq = np.full(count, (sigma * gain)**2), np.full(count, sigma**2)
    found = fit_exposure(value, reference, noise_sq)
    assert found is not None
    assert found.gain == pytest.approx(gain, rel=0.06)
    assert found.offset == pytest.approx(0.03, abs=0.02 * max(gain, 1.0))


def test_a_road_without_contrast_tells_its_gain_by_brightness():
    rng = np.random.default_rng(3)
    value, reference = (level + 0.01 * rng.standard_normal(500) for level in (0.6, 0.4))
    noise_sq = np.full(500, 1e-4), np.full(500, 1e-4)
    found = fit_exposure(value, reference, noise_sq)
    assert found == pytest.approx((1.5, 0.0), abs=0.01)
    assert fit_exposure(value[:5], reference[:5], (value[:5], value[:5])) is None


def test_gains_do_not_grow_where_frames_lie_askew():
    """Each frame has more contrast than the mean of all that lie askew."""
    rng, road = np.random.default_rng(6), np.random.default_rng(7).random(2000)
    frames = [0.35 + 0.1 * (road + rng.random(2000) - 1.0) for _ in range(100)]
    mean, noise_sq = frames[0], np.full(2000, 1e-6)
    for k, frame in enumerate(frames[1:], 1):
        found = fit_exposure(frame, mean, (noise_sq, noise_sq / k))
        mean = (k * mean + (frame - found.offset) / found.gain) / (k + 1)
    assert found.gain == pytest.approx(1.0, abs=0.1)


def pairs(shading, count=6, noise=0.004):
    rng = np.random.default_rng(4)
    for _ in range(count):
        road, gain = 0.3 + 0.1 * rng.random(3000), rng.uniform(0.7, 1.4)
        radii = rng.uniform(0.0, 0.5, 3000), rng.uniform(0.1, 0.9, 3000)
        a, b = (exposure * road / shading.lift(radius) + noise * rng.standard_normal(3000)
                for exposure, radius in zip((1.0, gain), radii, strict=True))
        yield CommonCells((a, b), radii, np.ones(3000))


def test_shading_is_told_by_road_seen_twice():
    true = Vignetting(0.2, 0.08)
    found = fit_vignetting(list(pairs(true)))
    at = np.array([0.3, 0.6, 0.9])
    assert found.lift(at) == pytest.approx(true.lift(at), rel=0.01)


def test_a_lens_without_shading_and_no_pairs_lift_nothing():
    found = fit_vignetting(list(pairs(Vignetting())))
    assert found.lift(np.array(0.9)) == pytest.approx(1.0, abs=0.01)
    assert fit_vignetting([]) == Vignetting()
    assert fit_vignetting(list(pairs(Vignetting(50.0, 0.0)))) == Vignetting()


def test_frames_of_another_exposure_give_one_map_of_honest_noise():
    rng = np.random.default_rng(5)
    builder, pixel = MapBuilder(R), 0.02
    world = 0.4 + 0.1 * rng.standard_normal((120, 200))
    for k in range(40):
        pose = Pose2(k * 0.1, 0.0, 0.0)
        ahead = pose.transform(GRID.points()) / R
        cells = world[np.floor(ahead[:, 1]).astype(int) + 60, np.floor(ahead[:, 0]).astype(int)]
        gain, offset = (1.0, 0.0) if k == 0 else (rng.uniform(0.6, 1.5), rng.uniform(-0.1, 0.1))
        grey = gain * cells.reshape(GRID.shape) + offset
        grey += pixel * rng.standard_normal(GRID.shape)
        assert builder.add(view_of(grey), np.full(GRID.shape, pixel**-2.0), pose)
    raster = builder.map()
    top, left = (int(k) for k in np.round(np.array([raster.origin.y, raster.origin.x]) / R))
    rows, cols = raster.grey.shape
    true = world[top + 60:top + 60 + rows, left:left + cols][::-1]
    error = (raster.grey / 65535.0 - true)[raster.valid]
    line = np.polyfit(true[raster.valid], raster.grey[raster.valid] / 65535.0, 1)
    assert line == pytest.approx([1.0, 0.0], abs=0.03)
    assert error.std() < 0.012
    assert np.mean(np.diff([e.gain for e in builder.exposures]) != 0.0) > 0.9
