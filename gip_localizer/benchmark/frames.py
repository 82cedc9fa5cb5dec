# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of a map for the benchmark's camera, and parameters for tracking them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Parameters

NOISE = 2.0
"""Standard deviation of the noise of a pixel, in grey levels of 255; chosen."""


def images(
    raster_map: RasterMap, camera: CameraModel, poses: Sequence[Pose2], seed: int = 0
) -> list[NDArray[np.uint8]]:
    """Return the camera image of the map at each pose; black outside the map."""
    rng = np.random.default_rng(seed)
    shape = (camera.height, camera.width)
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    xy, on_road = camera.road_points(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    xy = np.where(on_road[:, None], xy, 0.0)
    found = []
    for pose in poses:
        values, valid = raster_map.sample(pose.transform(xy))
        grey = 255.0 * np.where(valid & on_road, values, 0.0).reshape(shape)
        noisy = grey + NOISE * rng.standard_normal(shape, np.float32)
        found.append(np.clip(np.round(noisy), 0, 255).astype(np.uint8))
    return found


def tracking_parameters(camera: CameraModel, start: Pose2) -> Parameters:
    """Return parameters for tracking with a camera from a start pose."""
    held = camera.extrinsics
    return Parameters.from_dict({
        'camera.x': held.x, 'camera.y': held.y, 'camera.z': held.z, 'camera.roll': held.roll,
        'camera.pitch': held.pitch, 'camera.yaw': held.yaw, 'initial_pose.set': True,
        'initial_pose.x': start.x, 'initial_pose.y': start.y, 'initial_pose.yaw': start.yaw,
        'initial_pose.sigma_xy': 0.1, 'initial_pose.sigma_yaw': 0.01,
    })


def straight(start: Pose2, count: int, step: float) -> list[Pose2]:
    """Return poses along a straight line, `step` metres apart."""
    return [start @ Pose2(k * step, 0.0, 0.0) for k in range(count)]
