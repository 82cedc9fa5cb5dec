# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the covariance of a pose that the residuals of its fit do not contain."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.observation import Layer

# Share of the squared change since the last stage but one that counts as variance (no unit;
# design choice; see the laboratory notebook of docs/accuracy.md).
STAGE_SHARE = 0.001
# Largest change (map cells) that counts as variance (design choice: a larger change is the
# convergence itself).
MAX_CHANGE = 0.2
# Share of the weight that agrees where view and map differ by noise alone (no unit; design choice:
# 0.95, because the robust weights of normally distributed residuals add up to about that).
EXPECTED_INLIERS = 0.95
# Least share of the weight that is assumed to agree (no unit; design choice: 0.1, because the
# correction must stay finite).
MIN_INLIERS = 0.1
# Angle (rad) per metre of an error from interpolation (design choice: 0.2, an error at a lever arm
# of 5 m).
YAW_PER_M = 0.2


def mount_covariance(camera: Floats, sigma: float) -> Floats:
    """
    Return the covariance (3, 3) of the pose of base from the calibrated yaw of the camera.

    No frame shows this error: a frame locates the camera, and the error turns base around the
    camera.

    Parameters
    ----------
    camera : (3,)
        Position of the camera in base, metres.
    sigma : float
        Standard deviation of the yaw, rad.

    """
    lever = sigma * np.array([camera[1], -camera[0], 1.0])
    return np.outer(lever, lever)


def recognized_share(problem: LeastSquaresProblem) -> float:
    """
    Return the share of the road that agrees, relative to that with noise alone; at most 1.

    Occluders are never rejected completely: the larger the occluded share, the more occluded
    cells are used as road. With cars in the view the errors are 1.3 times those estimated from
    the cells that agree (measured, docs/accuracy.md); this share corrects for it. Where all of the
    road agrees it is 1.

    """
    return min(max(problem.inliers(), MIN_INLIERS) / EXPECTED_INLIERS, 1.0)


def sampling_covariance(coarser: Pose2, pose: Pose2, layer: Layer) -> Floats:
    """Return the covariance (3, 3) from interpolation and from the change since a stage."""
    locking = layer.locking
    change = difference(coarser.inverse() @ pose, Pose2(0.0, 0.0, 0.0))
    most = MAX_CHANGE * layer.raster_map.resolution
    change = change / max(np.hypot(change[0], change[1]) / most, 1.0)
    floor = np.diag([locking**2, locking**2, (YAW_PER_M * locking) ** 2])
    return np.asarray(floor + STAGE_SHARE * np.outer(change, change))
