# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The suite relocalize: search of the whole map without a prior, by `Localizer`.

Each area is measured in a process of its own, which prints one JSON object.

"""

from __future__ import annotations

import json
import math
import resource
import sys
import time
from typing import Any

import numpy as np

from gip_localizer.benchmark.children import child
from gip_localizer.benchmark.frames import images, tracking_parameters
from gip_localizer.benchmark.map_area import resident_mib
from gip_localizer.benchmark.rows import median, Row
from gip_localizer.benchmark.scene import camera, Scene
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import difference, Pose2

AREAS = {'1 ha': 100.0}
"""Sides of square maps, metres."""
FRAME_NS = 10**10
"""Time between two frames, nanoseconds; chosen: ten seconds."""
RIGHT_M, RIGHT_YAW = 0.5, math.radians(2.0)
"""Largest errors (m, rad) of a right place: the bounds of `gip evaluate`."""


def relocalize_suite(frames: int) -> tuple[list[Row], dict[str, Any]]:
    """Return a row per area, and what was found."""
    found = {
        case: child('gip_localizer.benchmark.relocalize', [str(side), str(frames)], {})
        for case, side in AREAS.items()
    }
    rows = [Row('relocalize', case, median(each['ms'])) for case, each in found.items()]
    return rows, found


def measure(side: float, frames: int) -> dict[str, Any]:
    """Search a square map of a world for frames anywhere on its lane."""
    scene = Scene(side)
    model = camera()
    rng = np.random.default_rng(0)
    parameters = tracking_parameters(model, Pose2(0.0, 0.0, 0.0)).replace(
        {'initial_pose.set': False, 'recovery.confirm_frames': 1}
    )
    localizer = Localizer(scene.map, parameters)
    localizer.prepare(model)
    before, times, right, wrong = resident_mib(), [], 0, 0
    for k in range(frames):
        pose = scene.place(rng)
        (image,) = images(scene.map, model, [pose], seed=k)
        localizer.relocalize()
        start = time.perf_counter()
        estimate = localizer.update((k + 1) * FRAME_NS, image, model)
        times.append(1e3 * (time.perf_counter() - start))
        if estimate.pose is not None:
            x, y, yaw = difference(estimate.pose, pose)
            near = math.hypot(x, y) < RIGHT_M and bool(abs(yaw) < RIGHT_YAW)
            right, wrong = right + near, wrong + (not near)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return {'side_m': side, 'ms': times, 'frames': frames, 'right': right, 'wrong': wrong,
            'rss_before_mib': before, 'rss_peak_mib': peak}


def main(arguments: list[str]) -> int:
    """Run `side frames` and print what was found."""
    json.dump(measure(float(arguments[0]), int(arguments[1])), sys.stdout)
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
