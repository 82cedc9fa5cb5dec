# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Worlds, the maps made of them, and what changes with the years."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.synthetic.texture import value_noise
from gip_localizer.synthetic.world_changes import changed
from gip_localizer.synthetic.world_tiles import tiles
from gip_localizer.synthetic.worlds import map_of, map_world, road_world, tiles_world


@pytest.fixture(scope='module')
def road():
    return road_world(seed=5, resolution=0.05)


def test_tiles_are_plus_and_minus_the_amplitude():
    grey = tiles(4.0, 2.0, 0.05, seed=0, side=0.2, amplitude=0.3, mean=0.5)
    assert grey.shape == (40, 80)
    assert np.allclose(np.unique(grey.round(5)), [0.2, 0.8])
    squares = grey.reshape(10, 4, 20, 4)
    assert np.all(squares == squares[:, :1, :, :1])
    assert 0.35 < (squares[:, 0, :, 0] > 0.5).mean() < 0.65


def test_tiles_that_cells_straddle_keep_their_area():
    fine = RasterMap(tiles(6.0, 3.0, 0.01, seed=2, side=0.25), 0.01)
    coarse = tiles(6.0, 3.0, 0.1, seed=2, side=0.25)
    assert np.allclose(map_of(fine, 10).grey, coarse, atol=1e-5)


def test_same_seed_same_world():
    worlds = [road_world(seed=s, size=(40.0, 25.0), resolution=0.1) for s in (1, 1, 2)]
    first, again, other = (world.raster.grey.tobytes() for world in worlds)
    assert first == again
    assert first != other


def test_road_is_reflectance_with_paint_on_asphalt(road):
    grey = road.raster.grey
    assert grey.dtype == np.float32
    assert grey.min() > 0.0
    assert grey.max() < 1.0
    assert 0.2 < np.median(grey) < 0.35
    assert 0.005 < (grey > 0.6).mean() < 0.1


def test_every_stretch_of_lane_has_texture_to_hold_on_to(road):
    for arc in np.arange(0.0, road.lane.length, 2.0):
        x, y = np.meshgrid(np.arange(3.0, 12.0, 0.1), np.arange(-3.0, 3.0, 0.1))
        points = road.lane.pose(arc).transform(np.column_stack([x.ravel(), y.ravel()]))
        values, valid = road.raster.sample(points)
        assert values[valid].std() > 0.03


def test_lane_is_a_drivable_loop_well_inside(road):
    lane = road.lane
    xy = lane.position(lane.stations)
    assert xy.min() > 4.0
    assert xy[:, 0].max() < 56.0
    assert xy[:, 1].max() < 36.0
    assert max(abs(lane.curvature(s)) for s in lane.stations) < 1 / 4.5
    paint, _ = road.raster.sample(lane.offset_positions(lane.stations, 1.75))
    assert 0.2 < (paint > 0.5).mean() < 0.65  # dashes on the left
    edge, _ = road.raster.sample(lane.offset_positions(lane.stations, -1.65))
    assert (edge > 0.5).mean() > 0.6  # a solid line on the right


def test_noise_has_the_asked_grain():
    for scale in (0.1, 0.4):
        noise = value_noise((500, 500), 0.02, scale, np.random.default_rng(0))
        assert noise.std() == pytest.approx(1.0, abs=1e-3)
        lag = round(scale / 0.02)
        near = np.mean(noise[:, : -(lag // 4)] * noise[:, lag // 4 :])
        far = np.mean(noise[:, : -3 * lag] * noise[:, 3 * lag :])
        assert near > 0.8
        assert abs(far) < 0.15


@pytest.mark.parametrize(('rows', 'cols', 'factor'), [(12, 20, 4), (13, 22, 4), (9, 9, 1)])
def test_map_cells_are_means_in_the_same_place(rows, cols, factor):
    rng = np.random.default_rng(0)
    world = RasterMap(rng.random((rows, cols)).astype(np.float32), 0.1, Pose2(3.0, -2.0, 0.7))
    coarse = map_of(world, factor)
    assert coarse.resolution == pytest.approx(0.1 * factor)
    middle = coarse.to_map(np.array([coarse.grey.shape[0] - 1.0, 0.0]))  # lower left
    cells = np.round(world.to_cell(middle) - (factor - 1) / 2).astype(int)
    block = world.grey[cells[0] : cells[0] + factor, cells[1] : cells[1] + factor]
    assert coarse.grey[-1, 0] == pytest.approx(block.mean(), abs=1e-6)


def test_map_cell_holds_data_where_all_of_it_does():
    valid = np.ones((8, 8), bool)
    valid[5, 1] = False
    coarse = map_of(RasterMap(np.zeros((8, 8), np.uint8), 0.1, valid=valid), 4)
    assert np.array_equal(coarse.valid, [[True, True], [False, True]])


@pytest.mark.parametrize('factor', [0, -1, 9])
def test_senseless_factors_are_refused(factor):
    with pytest.raises(MapError, match='factor'):
        map_of(RasterMap(np.zeros((8, 8), np.uint8), 0.1), factor)


def test_changes_cover_about_the_share(road):
    later = changed(road.raster, 0.2, seed=1)
    differs = np.abs(later.grey - road.raster.grey) > 1e-4
    assert 0.12 < differs.mean() < 0.26
    assert later.grey.min() >= 0.0
    assert later.grey.max() <= 1.0
    assert later.resolution == road.raster.resolution
    assert np.array_equal(later.grey, changed(road.raster, 0.2, seed=1).grey)
    painted = road.raster.grey > 0.6
    assert later.grey[painted].mean() < road.raster.grey[painted].mean() - 0.02


def test_nothing_changes_without_a_share(road):
    later = changed(road.raster, 0.0, seed=1)
    assert np.allclose(later.grey, road.raster.grey)


@pytest.mark.parametrize('yaw', [0.0, 0.8])
def test_loops_over_any_map_stay_on_it(yaw):
    world = tiles_world(resolution=0.1, origin=Pose2(100.0, -50.0, yaw))
    again = map_world(world.raster)
    for lane in (world.lane, again.lane):
        inside = world.raster.contains(lane.offset_positions(lane.stations, -2.0))
        assert inside.all()
