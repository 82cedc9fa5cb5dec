# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from camera_samples import HELD, make_camera, paper_camera
import numpy as np
import pytest

from gip_localizer.core.birdseye.footprints import footprint_areas, overlap_matrix, pixel_box
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.paper.geometry import depth_of_distance, PaperCamera
from gip_localizer.paper.theory import footprint

GRID = Grid(9.0, 2.0, 60, 40, 0.1)


def overlaps(camera: CameraModel, grid: Grid):
    areas, valid = footprint_areas(camera, grid)
    box = pixel_box(camera, grid, valid)
    return areas, valid, box, overlap_matrix(camera, grid, valid, box)


def paper_grid() -> tuple[CameraModel, Grid]:
    return paper_camera(), Grid(2.0, 0.9, 8, 9, 0.2)


def test_footprints_equal_the_paper_s_closed_form_in_its_geometry():
    camera, grid = paper_grid()
    areas, valid = footprint_areas(camera, grid)
    assert valid[:, 3:6].all()  # the middle columns are in view over all eight rows
    held = camera.extrinsics
    paper = PaperCamera(  # in metres and pixels here: its equations hold in any unit
        height=held.z, pitch_deg=math.degrees(held.pitch), focal_length=camera.K[0, 0]
    )
    for row in range(grid.rows):
        near = grid.far - (row + 1) * grid.resolution
        z_near, z_far = depth_of_distance(paper, np.array([near, near + 0.2]))
        expected = footprint(paper, np.array(0.2), z_near, z_far)
        np.testing.assert_allclose(areas[row][valid[row]], expected, rtol=0.005)


def test_the_pixels_of_a_cell_add_up_to_the_closed_form_too():
    camera, grid = paper_grid()
    areas, valid, _, matrix = overlaps(camera, grid)
    sums = np.asarray(matrix.sum(axis=1)).reshape(grid.shape)
    np.testing.assert_allclose(sums[valid], areas[valid], rtol=0.005)


@pytest.mark.parametrize('lens', ['none', 'plumb_bob', 'rational-14', 'equidistant'])
def test_areas_are_the_numeric_jacobian_of_road_to_pixel(lens):
    camera = make_camera(lens)
    areas, valid = footprint_areas(camera, GRID)
    assert valid.sum() > 500
    centres = GRID.points()[valid.ravel()]
    step = 1e-4
    along = [(camera.project(centres + step * axis)[0] - camera.project(centres - step * axis)[0])
             / (2 * step) for axis in np.eye(2)]
    determinant = np.abs(along[0][:, 0] * along[1][:, 1] - along[0][:, 1] * along[1][:, 0])
    # the Jacobian at the centre; the density falls as 1/z³, which the cell averages
    np.testing.assert_allclose(areas[valid], determinant * 0.1**2, rtol=0.01)


@pytest.mark.parametrize('lens', ['none', 'plumb_bob', 'equidistant'])
def test_overlaps_are_shares_of_pixels_and_lie_in_the_image(lens):
    camera = make_camera(lens)
    areas, valid, box, matrix = overlaps(camera, GRID)
    assert 0 <= box.u <= box.u + box.width <= camera.width
    assert 0 <= box.v <= box.v + box.height <= camera.height
    assert matrix.data.min() > 0.0
    assert np.asarray(matrix.sum(axis=0)).max() <= 1.0 + 1e-6
    sums = np.asarray(matrix.sum(axis=1)).ravel()
    assert not sums[~valid.ravel()].any()
    assert sums.sum() == pytest.approx(areas.sum(), rel=0.002)
    large = areas.ravel() > 20.0
    np.testing.assert_allclose(sums[large], areas.ravel()[large], rtol=0.08)


def test_a_pixel_is_given_to_the_cell_under_it():
    camera = make_camera('plumb_bob')
    _, valid, box, matrix = overlaps(camera, GRID)
    pixels = np.arange(box.width * box.height)
    v, u = np.divmod(pixels, box.width)
    xy, on_road = camera.road_points(np.column_stack([u + box.u, v + box.v]).astype(float))
    row, col = GRID.cell_of(xy)
    inside = on_road & (row >= 0) & (row < GRID.rows) & (col >= 0) & (col < GRID.cols)
    cell = (np.floor(row[inside]) * GRID.cols + np.floor(col[inside])).astype(int)
    seen = valid.ravel()[cell]
    share = np.asarray(matrix[cell[seen], pixels[inside][seen]]).ravel()
    assert (share > 0.0).mean() > 0.999


@pytest.mark.parametrize('offset', [0.0, 0.5, 1.0])
def test_cells_come_back_from_their_points(offset):
    row, col = GRID.cell_of(GRID.points(offset))
    expected = np.stack(np.meshgrid(np.arange(60), np.arange(40), indexing='ij'), -1) + offset
    np.testing.assert_allclose(np.stack([row, col], -1), expected.reshape(-1, 2), atol=1e-9)


def test_the_first_cell_is_far_and_left():
    points = GRID.points()
    np.testing.assert_allclose(points[0], [8.95, 1.95])
    np.testing.assert_allclose(points[-1], [3.05, -1.95])


def test_only_cells_that_are_whole_in_the_image_are_valid():
    camera = make_camera(held=Extrinsics(z=1.5, pitch=HELD.pitch))
    grid = Grid(6.0, 6.0, 50, 120, 0.1)
    areas, valid = footprint_areas(camera, grid)
    assert 0 < valid.sum() < valid.size
    assert not areas[~valid].any()
    for offset_row in (0.0, 1.0):
        for offset_col in (0.0, 1.0):
            x = grid.far - (np.arange(grid.rows) + offset_row) * grid.resolution
            y = grid.left - (np.arange(grid.cols) + offset_col) * grid.resolution
            corner = np.stack(np.meshgrid(x, y, indexing='ij'), -1).reshape(-1, 2)
            uv, seen = camera.project(corner[valid.ravel()])
            assert seen.all()
            assert (uv > -0.5).all()
            assert (uv < [639.5, 359.5]).all()
