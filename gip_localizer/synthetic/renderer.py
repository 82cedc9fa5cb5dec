# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Render a camera over a flat world: each pixel is the mean of the world over its footprint.

Between cell centres the world is interpolated bilinearly. Rays through strata of every pixel are
intersected with the road plane; the pixel is the mean of the world at these points.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.synthetic.pixel_grid import PixelGrid
from gip_localizer.synthetic.pixel_sampling import (
    EXACT,
    FAST,
    sample_groups,
    SampleGroup,
)
from gip_localizer.synthetic.road_shape import place_of, RoadShape

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]

_CHUNK = 4_000_000
"""Largest number of samples in memory at once in the exact renderer; chosen."""
_SWING = 0.06
"""Largest motion of the horizon, in rad: above the largest `disturbance.pitch` of 0.05 rad."""
OFF_MAP = 0.30
"""Reflectance, in [0, 1], outside the world and where it holds no data: that of asphalt."""


class Renderer:
    """
    Renders the image of a world, without lighting, vignetting or noise.

    Parameters
    ----------
    world : RasterMap
        Reflectance of the road; no data is shown as plain grey.
    camera : CameraModel
        Lens and nominal pose in the base frame.
    exact : bool
        True: dense samples of the world itself (seconds per frame; for tests). False: the
        image pyramid, for live use.
    shape : RoadShape or None
        Heights of the road; None: it is flat. The exact renderer knows flat roads only.

    Raises
    ------
    MapError
        The world has more than 32766 cells along a side.

    """

    def __init__(
        self, world: RasterMap, camera: CameraModel, *, exact: bool = False,
        shape: RoadShape | None = None,
    ) -> None:
        if max(world.grey.shape) > 32766:
            raise MapError(
                f'world of {world.grey.shape[1]} x {world.grey.shape[0]} cells; '
                'expected at most 32766 a side: cut the map, or give it larger cells'
            )
        self.camera = camera
        self.exact = exact
        self._shape = shape
        self._world = world
        self._grid = PixelGrid(camera)
        self._upper = _upper_pixels(self._grid, camera)
        grey = _filled(world)
        self._levels = [grey] if exact else _pyramid(grey, FAST.max_level)
        quality = EXACT if exact else FAST
        self._quality = quality
        groups = sample_groups(self._grid, camera, world.resolution, quality, chunk=_CHUNK)
        self._groups = None if exact else list(groups)

    def render(self, pose: Pose2, extrinsics: Extrinsics | None = None) -> Floats32:
        """
        Return the image seen from a pose.

        Parameters
        ----------
        pose : Pose2
            T_map_base.
        extrinsics : Extrinsics, optional
            Mounting pose in this frame (suspension); the nominal pose if not given.

        Returns
        -------
        (height, width) float32
            Reflectance in [0, 1]; grey sky above the horizon, black outside the field of view.

        """
        extrinsics = extrinsics or self.camera.extrinsics
        R_base_camera = self._rotation(extrinsics)
        image = np.zeros(self._grid.shape[0] * self._grid.shape[1], np.float32)
        H_cell_ray = self._cells_from_rays(pose, extrinsics, R_base_camera)
        look_up = self._look_up_exact if self.exact else partial(
            self._look_up, meet=self._meeting(pose, extrinsics)
        )
        for group in self._groups or self._chunks():
            image[group.pixels] = look_up(group, H_cell_ray)
        self._paint_sky(image, R_base_camera)
        return image.reshape(self._grid.shape)

    def render_moving(
        self, poses: Sequence[Pose2], extrinsics: Extrinsics | None = None
    ) -> Floats32:
        """Return the mean of the images from several poses: the exposure of a moving camera."""
        total = self.render(poses[0], extrinsics)
        for pose in poses[1:]:
            total += self.render(pose, extrinsics)
        return total / np.float32(len(poses))

    def _rotation(self, extrinsics: Extrinsics) -> Floats:
        """Return R_base_camera for other extrinsics."""
        nominal = self.camera.extrinsics.rotation()
        return extrinsics.rotation() @ nominal.T @ self.camera.R_base_camera

    def _cells_from_rays(
        self, pose: Pose2, extrinsics: Extrinsics, R_base_camera: Floats
    ) -> Floats:
        """Homography from normalised rays (x, y, 1) to the world's (column, row), (3, 3)."""
        h = extrinsics.z
        road = np.vstack([
            -h * R_base_camera[0] + extrinsics.x * R_base_camera[2],
            -h * R_base_camera[1] + extrinsics.y * R_base_camera[2],
            R_base_camera[2],
        ])
        T_grid_base = self._world.origin.inverse() @ pose
        to_grid = np.eye(3)
        to_grid[:2, :2], to_grid[:2, 2] = T_grid_base.rotation(), (T_grid_base.x, T_grid_base.y)
        scale = 1.0 / self._world.resolution
        rows = self._world.grey.shape[0]
        to_cell = np.array([[scale, 0.0, -0.5], [0.0, -scale, rows - 0.5], [0.0, 0.0, 1.0]])
        return np.asarray(to_cell @ to_grid @ road, float)

    def _meeting(
        self, pose: Pose2, extrinsics: Extrinsics
    ) -> Callable[[Floats32], Floats32] | None:
        """Return what moves cells of the tangent plane to where the rays meet the road."""
        if self._shape is None:
            return None
        base, axes = place_of(self._world, pose)
        camera = base + np.array([extrinsics.x, extrinsics.y]) @ axes
        plane = self._shape.tangent(base, axes)
        return partial(self._shape.met, camera=camera, height=extrinsics.z, plane=plane)

    def _look_up(
        self, group: SampleGroup, H_cell_ray: Floats, *,
        meet: Callable[[Floats32], Floats32] | None,
    ) -> Floats32:
        """Return the mean sample of each of a group's pixels, (m,)."""
        samples, count = group.samples, len(group.pixels)
        shrink = 0.5**group.level
        if meet is None:
            to_level = np.diag([shrink, shrink, 1.0])
            to_level[:2, 2] = 0.5 * shrink - 0.5
            cells = np.asarray(cv2.perspectiveTransform(group.rays, to_level @ H_cell_ray))
        else:
            cells = meet(np.asarray(cv2.perspectiveTransform(group.rays, H_cell_ray)))
            cells = cells * np.float32(shrink) + np.float32(0.5 * shrink - 0.5)
        values = cv2.remap(
            self._levels[group.level], cells, None, cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT, borderValue=OFF_MAP,
        )
        flat = np.asarray(values, np.float32).reshape(-1)[: samples * count]
        if samples == 1:
            return flat
        return np.asarray(flat.reshape(samples, count).mean(axis=0), np.float32)

    def _look_up_exact(self, group: SampleGroup, H_cell_ray: Floats) -> Floats32:
        """Return the same means from the world itself, in double precision."""
        count = group.samples * len(group.pixels)
        rays = group.rays.reshape(-1, 2)[:count].astype(float)
        homogeneous = rays @ H_cell_ray[:, :2].T + H_cell_ray[:, 2]
        below = homogeneous[..., 2] < 0.0
        depth = np.where(below, homogeneous[..., 2], -1e-9)
        col, row = homogeneous[..., 0] / depth, homogeneous[..., 1] / depth
        values = map_coordinates(
            self._levels[0], [row, col], np.float64, order=1, mode='grid-constant', cval=OFF_MAP
        )
        seen = np.where(below, values, OFF_MAP).reshape(group.samples, -1)
        return np.asarray(seen.mean(axis=0), np.float32)

    def _chunks(self) -> Sequence[SampleGroup]:
        return sample_groups(  # type: ignore[return-value]
            self._grid, self.camera, self._world.resolution, self._quality, chunk=_CHUNK
        )

    def _paint_sky(self, image: Floats32, R_base_camera: Floats) -> None:
        """Blend a sky that gets darker upwards over the pixels above the horizon, in place."""
        pixels, rays = self._upper
        rise = rays @ R_base_camera[2, :2].astype(np.float32) + np.float32(R_base_camera[2, 2])
        share = np.clip(rise * np.float32(self.camera.K[1, 1]) + 0.5, 0.0, 1.0)
        sky = 0.85 - 0.25 * np.clip(rise, 0.0, 1.0)
        road = image[pixels]
        image[pixels] = road + share * (sky - road)


def _upper_pixels(grid: PixelGrid, camera: CameraModel) -> tuple[NDArray[np.int64], Floats32]:
    """Return the pixels (n,) that may show sky when the camera pitches, and their rays (n, 2)."""
    rise = grid.centres @ camera.R_base_camera[2, :2] + camera.R_base_camera[2, 2]
    pixels = np.flatnonzero((rise > -_SWING) & grid.visible.ravel())
    return pixels, grid.centres[pixels].astype(np.float32)


def _filled(world: RasterMap) -> Floats32:
    """Return the world's reflectance in [0, 1], plain grey where there is no data."""
    grey = on_unit_scale(world.grey)
    if world.valid is None:
        return grey
    return np.where(world.valid, grey, np.float32(OFF_MAP))


def _pyramid(grey: Floats32, levels: int) -> list[Floats32]:
    """Return the world and its coarser levels; each cell is the mean of four finer cells."""
    pyramid = [grey]
    for _ in range(levels):
        finer = pyramid[-1]
        bottom, right = finer.shape[0] % 2, finer.shape[1] % 2
        even = cv2.copyMakeBorder(
            finer, 0, bottom, 0, right, cv2.BORDER_CONSTANT, value=OFF_MAP
        )
        size = (even.shape[1] // 2, even.shape[0] // 2)
        pyramid.append(np.asarray(cv2.resize(even, size, interpolation=cv2.INTER_AREA)))
    return pyramid
