# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The initial pose of a replay, compared with the ground truth at the first image."""

from __future__ import annotations

import math

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.errors import TrajectoryError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics
from gip_localizer.io.bags.truth import truth_at_first_image
from gip_localizer.io.bags.window import BagWindow
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.parameters.integration import InitialPose

DOUBTED = 3.0
"""Standard deviations between `initial_pose.*` and the truth that are reported; chosen."""


def start_note(
    given: InitialPose, bag: Bag, topics: Topics, truth: Trajectory | None, window: BagWindow
) -> str:
    """Return what is to be said of an initial pose that the truth contradicts; else nothing."""
    if not given.set or truth is None:
        return ''
    try:
        start = truth_at_first_image(bag, topics, truth, window)
    except TrajectoryError:
        return ''
    apart = difference(Pose2(given.x, given.y, given.yaw), start)
    distance, turn = math.hypot(apart[0], apart[1]), abs(float(apart[2]))
    if distance <= DOUBTED * given.sigma_xy and turn <= DOUBTED * given.sigma_yaw:
        return ''
    return (
        f'initial_pose.* is {distance:.2f} m and {math.degrees(turn):.1f} degrees from the ground '
        f'truth at the first image that is replayed (sigma {given.sigma_xy:g} m, '
        f'{math.degrees(given.sigma_yaw):.1f} degrees); it holds for that image, not for the '
        'beginning of the bag: give --initial-pose truth or X,Y,YAW'
    )
