# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st
from match_samples import texture
import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.ndimage import map_coordinates

from gip_localizer.core.map.cell_range import CellRange
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import doubled
from gip_localizer.core.map.versions import doubled_map, smoothed_map
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError

origins = st.builds(Pose2, st.floats(-1e3, 1e3), st.floats(-1e3, 1e3), st.floats(-3.2, 3.2))
GREY = texture((30, 40))


@given(origins, st.floats(0.01, 2.0), st.floats(-50.0, 90.0), st.floats(-50.0, 90.0))
def test_cells_and_metres_are_inverse(origin, resolution, row, col):
    raster_map = RasterMap(GREY, resolution, origin)
    rc = np.array([[row, col]])
    np.testing.assert_allclose(raster_map.to_cell(raster_map.to_map(rc)), rc, atol=1e-6)


def test_the_lower_left_corner_is_the_origin_and_row_0_is_the_top():
    grey = np.zeros((3, 5), np.uint8)
    grey[2, 0] = 255  # lower left
    raster_map = RasterMap(grey, 0.5, Pose2(10.0, 20.0, 0.0))
    np.testing.assert_allclose(raster_map.to_map(np.array([2, 0])), [10.25, 20.25])
    values, valid = raster_map.sample(np.array([[10.25, 20.25], [10.25, 21.25], [12.25, 20.25]]))
    assert valid.all()
    np.testing.assert_allclose(values, [1.0, 0.0, 0.0])
    assert raster_map.bounds == pytest.approx((10.0, 20.0, 12.5, 21.5))
    assert raster_map.size_m == (2.5, 1.5)


def test_the_origin_s_yaw_turns_the_map_about_its_corner():
    grey = np.zeros((3, 5), np.uint8)
    grey[2, 4] = 255  # the far end of the bottom row
    raster_map = RasterMap(grey, 0.5, Pose2(10.0, 20.0, math.pi / 2))
    np.testing.assert_allclose(raster_map.to_map(np.array([2, 4])), [9.75, 22.25], atol=1e-12)
    values, valid = raster_map.sample(np.array([[9.75, 22.25], [9.75, 20.25]]))
    assert valid.all()
    np.testing.assert_allclose(values, [1.0, 0.0], atol=1e-6)
    assert raster_map.bounds == pytest.approx((8.5, 20.0, 10.0, 22.5))


@pytest.mark.parametrize(('dtype', 'white'), [
    (np.uint8, 255), (np.uint16, 65535), (np.float32, 1.0),
])
def test_samples_are_bilinear_in_every_depth(dtype, white):
    grey = (GREY * white).astype(dtype)
    raster_map = RasterMap(grey, 0.1, Pose2(1.0, 2.0, 0.7))
    rc = np.random.default_rng(3).uniform([0, 0], [29, 39], (500, 2))
    values, valid = raster_map.sample(raster_map.to_map(rc))
    expected = map_coordinates(grey.astype(float) / white, rc.T, order=1)
    assert valid.all()
    np.testing.assert_allclose(values, expected, atol=1e-5)
    assert values.dtype == np.float32


@settings(max_examples=25)
@given(origins, st.integers(0, 2**31))
def test_the_gradient_is_the_slope_of_the_samples(origin, seed):
    raster_map = RasterMap(GREY, 0.1, origin)
    rng = np.random.default_rng(seed)
    rc = rng.integers(0, [29, 39], (40, 2)) + rng.uniform(0.2, 0.8, (40, 2))
    xy, step = raster_map.to_map(rc), 0.01
    along = raster_map.sample_from(Pose2(0.0, 0.0, 0.0), xy[:, 0], xy[:, 1]).slopes()
    gradient = np.stack(along, axis=1)
    for axis, unit in enumerate(np.eye(2)):
        high, low = (raster_map.sample(xy + sign * step * unit)[0] for sign in (1, -1))
        np.testing.assert_allclose(gradient[:, axis], (high - low) / (2 * step), atol=0.02)


def test_the_edge_of_the_map_is_the_edge_of_its_cells():
    raster_map = RasterMap(GREY, 0.1)
    inside = np.array([[1e-6, 1e-6], [3.999999, 2.999999], [0.05, 2.95]])
    outside = np.array([[-0.001, 1.0], [4.001, 1.0], [1.0, -0.001], [1.0, 3.001], [np.nan, 1.0]])
    values, valid = raster_map.sample(inside)
    assert valid.all()
    np.testing.assert_allclose(values, GREY[[29, 0, 0], [0, 39, 0]], atol=1e-6)
    values, valid = raster_map.sample(outside)
    assert not valid.any()
    assert not values.any()
    assert raster_map.contains(inside).all()
    assert not raster_map.contains(outside).any()


def test_cells_without_data_invalidate_every_sample_they_touch():
    valid = np.ones(GREY.shape, bool)
    valid[10, 20] = False
    raster_map = RasterMap(GREY, 1.0, valid=valid)
    near = np.array([[10, 20], [10.9, 20], [9.1, 19.1]])
    away = np.array([[11.1, 20], [10, 21.1], [8.9, 20]])
    assert not raster_map.sample(raster_map.to_map(near))[1].any()
    assert raster_map.sample(raster_map.to_map(away))[1].all()


@pytest.mark.parametrize('shape', [(1, 1), (1, 7), (7, 1)])
def test_maps_of_one_row_or_column_can_be_sampled(shape):
    raster_map = RasterMap(np.full(shape, 51, np.uint8), 1.0)
    rows, cols = shape
    values, valid = raster_map.sample(np.array([[0.5, 0.5], [cols - 0.1, rows - 0.1], [-1, 0]]))
    assert valid.tolist() == [True, True, False]
    np.testing.assert_allclose(values[:2], 0.2, atol=1e-6)


@pytest.mark.parametrize('origin', [Pose2(0, 0, 0), Pose2(-5.0, 3.0, 1.1)])
def test_a_crop_samples_like_the_map(origin):
    valid = np.ones(GREY.shape, bool)
    valid[:3] = False
    raster_map = RasterMap((GREY * 255).astype(np.uint8), 0.1, origin, valid)
    points = raster_map.to_map(np.random.default_rng(1).uniform([2, 10], [15, 20], (100, 2)))
    crop = raster_map.crop(points, margin=0.1, cell=0.1)
    assert crop.grey.shape < raster_map.grey.shape
    assert crop.grey.dtype == np.float32
    for a, b in zip(crop.sample(points), raster_map.sample(points), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-5)


def test_a_crop_for_larger_cells_is_smoothed_and_decimated():
    noise = np.random.default_rng(2).random((400, 400)).astype(np.float32)
    raster_map = RasterMap(noise, 0.05)
    points = np.array([[5.0, 5.0], [15.0, 15.0]])
    crop = raster_map.crop(points, margin=0.0, cell=0.4)
    assert crop.resolution == pytest.approx(0.2)
    assert crop.grey.std() < 0.25 * noise.std()
    assert crop.grey.mean() == pytest.approx(0.5, abs=0.01)
    assert crop.sample(points)[1].all()
    ramp = np.tile(np.linspace(0.0, 1.0, 400, dtype=np.float32), (400, 1))
    smooth = RasterMap(ramp, 0.05).crop(points, margin=0.0, cell=0.4)
    probe = np.random.default_rng(3).uniform(6.0, 14.0, (50, 2))
    np.testing.assert_allclose(
        smooth.sample(probe)[0], RasterMap(ramp, 0.05).sample(probe)[0], atol=1e-3
    )


def test_half_cells_lie_on_the_splines_through_the_cells():
    raster_map = RasterMap(GREY, 0.05)
    half = np.meshgrid(*((np.arange(2 * n) - 0.5) / 2.0 for n in GREY.shape), indexing='ij')
    expected = map_coordinates(GREY, half, order=3, mode='nearest')
    inside = np.s_[12:-12, 12:-12]
    np.testing.assert_allclose(doubled_map(raster_map).grey[inside], expected[inside], atol=2e-3)


def test_a_crop_off_the_map_is_none():
    assert RasterMap(GREY, 0.1).crop(np.array([[500.0, 0.0]]), margin=1.0, cell=0.1) is None


def test_smoothing_does_not_let_unknown_cells_leak():
    valid = np.ones((60, 60), bool)
    valid[:, 30:] = False
    grey = np.where(valid, np.float32(0.2), np.float32(1.0))
    raster_map = RasterMap(grey, 0.05, valid=valid)
    crop = raster_map.crop(np.array([[0.2, 0.2], [2.8, 2.8]]), margin=0.0, cell=0.3)
    np.testing.assert_allclose(crop.grey[crop.valid], 0.2, atol=1e-4)
    assert 0 < crop.valid.sum() < crop.valid.size


@pytest.mark.parametrize(('change', 'word'), [
    ({'grey': np.zeros((0, 5), np.uint8)}, 'shape'),
    ({'grey': np.zeros((4, 5, 3), np.uint8)}, 'shape'),
    ({'grey': np.zeros((4, 5), np.int32)}, 'int32'),
    ({'grey': np.zeros((4, 5), np.float64)}, 'float64'),
    ({'resolution': 0.0}, 'resolution'),
    ({'resolution': -0.05}, 'resolution'),
    ({'resolution': math.nan}, 'resolution'),
    ({'resolution': math.inf}, 'resolution'),
    ({'origin': Pose2(0.0, math.nan, 0.0)}, 'origin'),
    ({'valid': np.ones((3, 3), bool)}, 'mask'),
    ({'grey': np.full((4, 5), math.nan, np.float32)}, 'grey holds NaN'),
    ({'noise': np.full((4, 5), math.inf, np.float32)}, 'noise holds NaN or infinity'),
])
def test_what_cannot_be_a_map_is_refused(change, word):
    with pytest.raises(MapError, match=word):
        RasterMap(**{'grey': np.zeros((4, 5), np.uint8), 'resolution': 0.1, **change})


def test_noise_goes_with_a_map_and_falls_with_averaging():
    noise = np.full((60, 80), 51, np.uint8)
    raster_map = RasterMap(np.zeros((60, 80), np.uint8), 0.05, noise=noise)
    corners = np.array([[1.0, 1.0], [2.0, 2.0]])
    same, joined = (raster_map.crop(corners, margin=0.2, cell=cell) for cell in (0.05, 0.2))
    np.testing.assert_allclose(same.noise, 0.2, rtol=1e-6)
    assert same.noise.shape == same.grey.shape
    assert doubled_map(same).noise.shape == doubled_map(same).grey.shape
    # 2 x 2 cells are joined, and smoothed to as many again
    np.testing.assert_allclose(joined.noise, 0.2 / 4.0, rtol=1e-5)
    np.testing.assert_allclose(smoothed_map(same, 0.1, 0.05).noise, 0.1, rtol=1e-6)


@pytest.mark.parametrize(('cells', 'done'), [
    ((0.14,), 2.8), ((0.14, 0.14), 2.8), ((0.14, 0.3), 6.0),
])
@pytest.mark.parametrize('kind', [np.uint8, np.float32])
def test_a_map_finer_than_the_view_is_smoothed_once(cells, done, kind):
    '''Second moment of a dot: of a box of the last cell, less what bilinear sampling adds.'''
    white = 200 if kind is np.uint8 else 200.0 / 255.0
    grey = np.zeros((81, 81), kind)
    grey[40, 40] = white
    noise = np.full((81, 81), 0.2, np.float32)
    whole = CellRange(row=0, row_end=81, col=0, col_end=81)
    first, *others = cells
    raster_map = RasterMap(grey, 0.05, noise=noise).cut(whole, first)
    for cell in others:
        raster_map = smoothed_map(raster_map, cell, first)
    values = raster_map.grey.astype(float)
    np.testing.assert_allclose(values.sum(), 200.0 / 255.0, rtol=1e-4)
    offsets = np.arange(81) - 40.0
    moment = (values.sum(axis=0) * offsets**2).sum() / values.sum()
    np.testing.assert_allclose(moment, (done**2 - 1.0) / 12.0, rtol=0.05)
    np.testing.assert_allclose(raster_map.noise, 0.2 / done, rtol=1e-5)


def test_noise_of_another_shape_is_refused():
    with pytest.raises(MapError, match='noise has shape'):
        RasterMap(np.zeros((6, 8), np.uint8), 0.05, noise=np.zeros((6, 7), np.uint8))


def test_a_doubled_map_is_the_cubic_spline_through_its_cells():
    cells = np.random.default_rng(2).random((40, 40)).astype(np.float32)
    at = np.arange(40)
    columns = CubicSpline(at, cells.astype(float), axis=1, bc_type='natural')
    rows = CubicSpline(at, columns(np.arange(5, 35) + 0.25), axis=0, bc_type='natural')
    made = doubled(cells)[11:71:2, 11:71:2]
    assert made == pytest.approx(rows(np.arange(5, 35) + 0.25), abs=2e-3)
