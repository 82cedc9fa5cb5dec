# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""From an `initialpose` message to a prior: checks of frame and place, missing covariance."""

from __future__ import annotations

from typing import Any

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.io import messages
from gip_localizer.parameters import Parameters


def prior_of(message: Any, parameters: Parameters, raster_map: RasterMap) -> tuple[Pose2, Floats]:
    """
    Return the pose of a geometry_msgs/PoseWithCovarianceStamped and its (3, 3) covariance.

    Raises
    ------
    PoseMessageError
        Its frame is not the map frame, a number is not finite, or it is outside the map.

    """
    frame, expected = str(message.header.frame_id), parameters.frames.map
    if frame.lstrip('/') != expected.lstrip('/'):
        raise messages.PoseMessageError(
            f'initialpose is in frame {frame!r}; expected {expected!r}'
        )
    pose = messages.planar_pose(message.pose.pose)
    if not bool(raster_map.contains(np.array([pose.x, pose.y]))):
        low_x, low_y, high_x, high_y = raster_map.bounds
        raise messages.PoseMessageError(
            f'initialpose ({pose.x:.1f}, {pose.y:.1f}) is outside the map '
            f'(x {low_x:.1f} to {high_x:.1f}, y {low_y:.1f} to {high_y:.1f})'
        )
    return pose, _filled(messages.planar_covariance(message.pose.covariance), parameters)


def _filled(covariance: Floats, parameters: Parameters) -> Floats:
    """Put `initial_pose.sigma_*` where a variance is zero: many clients leave it unset."""
    start = parameters.initial_pose
    defaults = np.array([start.sigma_xy, start.sigma_xy, start.sigma_yaw]) ** 2
    missing = np.diag(covariance) == 0.0
    filled = np.array(covariance, float)
    filled[missing, :] = filled[:, missing] = 0.0
    filled[missing, missing] = defaults[missing]
    return filled
