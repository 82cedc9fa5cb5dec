# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The renderer against brute force, OpenCV's projection and the laws of averaging."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.synthetic.renderer import OFF_MAP, Renderer
from gip_localizer.synthetic.world_tiles import tiles
from gip_localizer.synthetic.worlds import road_world

PLAIN = np.zeros(0)
BARREL = np.array([-0.3, 0.08, 0.001, -0.001, 0.0])
POSE = Pose2(10.0, 6.25, 0.1)


def make_camera(distortion: np.ndarray = PLAIN, scale: float = 0.25) -> CameraModel:
    width, height = round(1280 * scale), round(720 * scale)
    focal = 900.0 * scale
    K = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    held = Extrinsics(1.2, 0.3, 1.5, 0.02, np.deg2rad(15.0), -0.04)
    return CameraModel(Calibration(width, height, K, distortion), held)


def brute_force(world: RasterMap, camera: CameraModel, uv: np.ndarray, side: int) -> np.ndarray:
    """Mean of side x side rays through each pixel, each looked up in the map by itself."""
    offsets = (np.arange(side) + 0.5) / side - 0.5
    du, dv = (grid.ravel() for grid in np.meshgrid(offsets, offsets))
    means = []
    for u, v in uv:
        xy, valid = camera.road_points(np.column_stack([u + du, v + dv]))
        values, known = world.sample(POSE.transform(xy[valid]))
        assert valid.all()
        assert known.all()
        means.append(float(values.mean()))
    return np.array(means)


@pytest.fixture(scope='module')
def world() -> RasterMap:
    return road_world(seed=3, size=(45.0, 25.0), resolution=0.05).raster


@pytest.mark.parametrize('distortion', [PLAIN, BARREL])
def test_pixels_are_means_over_their_footprints(world, distortion):
    camera = make_camera(distortion)
    v = np.repeat(np.arange(48, 178, 10), 9)
    uv = np.column_stack([np.tile(np.linspace(90, 230, 9).round(), 13), v]).astype(int)
    expected = brute_force(world, camera, uv, 64)
    exact = Renderer(world, camera, exact=True).render(POSE)[uv[:, 1], uv[:, 0]]
    fast = Renderer(world, camera).render(POSE)[uv[:, 1], uv[:, 0]]
    point = world.sample(POSE.transform(camera.road_points(uv.astype(float))[0]))[0]
    assert np.abs(exact - expected).max() < 0.004
    assert np.sqrt(np.mean((fast - expected) ** 2)) < 1.5 / 255
    assert np.sqrt(np.mean((point - expected) ** 2)) > 5 / 255  # a point sample would fail


def test_fast_agrees_with_exact_on_the_whole_road(world):
    camera = make_camera(scale=0.125)
    difference = Renderer(world, camera).render(POSE) - Renderer(
        world, camera, exact=True
    ).render(POSE)
    below_horizon = difference[18:]
    assert np.sqrt(np.mean(below_horizon**2)) < 1 / 255


def test_far_checkerboard_is_grey():
    squares = np.indices((800, 1600)).sum(axis=0) % 2
    board = RasterMap(squares.astype(np.float32), 0.05)
    camera = make_camera()
    image = Renderer(board, camera).render(Pose2(5.0, 20.0, 0.0))
    xy, valid = camera.road_points(np.column_stack([np.full(180, 160.0), np.arange(180.0)]))
    far = valid & (xy[:, 0] > 20.0) & (xy[:, 0] < 45.0)
    assert far.sum() > 8
    assert np.abs(image[far, 160] - 0.5).max() < 0.02


@pytest.mark.parametrize('distortion', [PLAIN, BARREL])
def test_a_road_point_is_where_opencv_projects_it(distortion):
    camera = make_camera(distortion, scale=0.5)
    spot = np.array([6.5, -0.8])
    x, y = POSE.transform(spot)
    offsets = (np.arange(1000) - 499.5) * 0.02
    distance_sq = offsets[:, None] ** 2 + offsets[None, :] ** 2
    grey = np.exp(-0.5 * distance_sq / 0.15**2).astype(np.float32)
    board = RasterMap(grey, 0.02, Pose2(x - 10.0, y - 10.0, 0.0))
    image = Renderer(board, camera).render(POSE)
    # Road points around the spot, whose brightness is known, are projected by OpenCV; where the
    # image differs from it, its gradient says by how many pixels it is displaced.
    around = np.random.default_rng(0).normal(0.0, 0.15, (4000, 2))
    points = np.column_stack([spot + around, np.zeros(len(around))])
    R_camera_base = camera.extrinsics.rotation().T
    rotation, _ = cv2.Rodrigues(R_camera_base)
    translation = -R_camera_base @ camera.extrinsics.position()
    uv, _ = cv2.projectPoints(points[:, None], rotation, translation, camera.K, distortion)
    rows, cols = uv[:, 0, 1], uv[:, 0, 0]
    seen, slope_v, slope_u = (
        map_coordinates(layer, [rows, cols], order=1) for layer in (image, *np.gradient(image))
    )
    known = np.exp(-0.5 * (around**2).sum(axis=1) / 0.15**2)
    shift, *_ = np.linalg.lstsq(np.column_stack([slope_u, slope_v]), seen - known, rcond=None)
    assert np.abs(shift).max() < 0.02


def test_swinging_camera_is_the_camera_held_there(world):
    camera = make_camera()
    held = camera.extrinsics
    swung = replace(held, pitch=held.pitch + 0.012, roll=held.roll - 0.004, z=held.z + 0.01)
    there = Renderer(world, camera.with_extrinsics(swung)).render(POSE)
    swinging = Renderer(world, camera).render(POSE, swung)
    assert np.sqrt(np.mean((there - swinging) ** 2)) < 1 / 255
    assert np.sqrt(np.mean((there - Renderer(world, camera).render(POSE)) ** 2)) > 5 / 255


def test_moving_map_and_vehicle_together_changes_nothing(world):
    camera = make_camera()
    T = Pose2(-120.0, 33.0, 2.1)
    moved = replace(world, origin=T @ world.origin)
    image = Renderer(world, camera).render(POSE)
    assert np.abs(Renderer(moved, camera).render(T @ POSE) - image).max() < 2e-3


def test_eight_bit_world_is_the_same_world(world):
    grey = np.round(world.grey * 255.0).astype(np.uint8)
    camera = make_camera()
    eight = Renderer(replace(world, grey=grey), camera).render(POSE)
    assert np.abs(eight - Renderer(world, camera).render(POSE)).max() < 0.6 / 255


def test_off_the_map_and_without_data_is_plain(world):
    camera = make_camera()
    away = Renderer(world, camera).render(Pose2(1e4, 1e4, 0.0))
    assert np.allclose(away[60:], OFF_MAP)
    unknown = replace(world, valid=np.zeros(world.grey.shape, bool))
    assert np.allclose(Renderer(unknown, camera).render(POSE)[60:], OFF_MAP)


def test_sky_is_bright_and_the_camera_looking_up_sees_only_it(world):
    camera = make_camera()
    assert Renderer(world, camera).render(POSE)[:15].min() > 0.55
    upwards = camera.with_extrinsics(replace(camera.extrinsics, pitch=-1.0))
    assert Renderer(world, upwards).render(POSE).min() > 0.5


def test_moving_camera_sees_the_mean(world):
    renderer = Renderer(world, make_camera())
    poses = [POSE, POSE @ Pose2(0.05, 0.0, 0.0), POSE @ Pose2(0.1, 0.0, 0.0)]
    mean = np.mean([renderer.render(pose) for pose in poses], axis=0)
    assert np.allclose(renderer.render_moving(poses), mean, atol=1e-6)


def test_same_arguments_same_bytes(world):
    camera = make_camera()
    first = Renderer(world, camera).render(POSE).tobytes()
    assert first == Renderer(world, camera).render(POSE).tobytes()


def test_tiles_keep_their_mean_at_any_pose():
    board = RasterMap(tiles(30.0, 20.0, 0.05, seed=1, side=0.2, amplitude=0.0, mean=0.4), 0.05)
    image = Renderer(board, make_camera()).render(Pose2(5.0, 10.0, 0.3))
    assert np.allclose(image[90:, 60:260], 0.4, atol=1e-5)


def test_world_too_large_for_opencv_is_refused():
    strip = RasterMap(np.zeros((1, 40000), np.uint8), 0.05)
    with pytest.raises(MapError, match='at most 32766'):
        Renderer(strip, make_camera())
