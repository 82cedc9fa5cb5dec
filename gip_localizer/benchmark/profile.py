# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Times of the stages of a tracked frame, and peak performance of the machine."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from gip_localizer.benchmark.frames import images, straight, tracking_parameters
from gip_localizer.benchmark.rows import median, Row
from gip_localizer.benchmark.scene import camera, CELL
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import Pose2
from gip_localizer.synthetic.worlds import road_world

FRAMES = 40
"""Number of tracked frames per round; chosen."""


def profile_suite(rounds: int) -> tuple[list[Row], dict[str, Any]]:
    """Track frames of 1280x720 with default parameters; return the time of each stage."""
    world = road_world(seed=0, resolution=CELL)
    model = camera()
    x, y = world.lane.position(np.array([5.0]))[0]
    start = Pose2(float(x), float(y), float(world.lane.heading(np.array([5.0]))[0]))
    seen = images(world.raster, model, straight(start, FRAMES, 0.05))
    localizer = Localizer(world.raster, tracking_parameters(model, start))
    stages: dict[str, list[float]] = {}
    total, published = [], 0
    order = [*range(FRAMES), *range(FRAMES - 2, 0, -1)] * rounds
    for k, frame in enumerate(order):
        began = time.perf_counter()
        estimate = localizer.update((k + 1) * 33_000_000, seen[frame], model)
        total.append(1e3 * (time.perf_counter() - began))
        published += estimate.published
        if k:
            for name, spent in estimate.timings_ms.items():
                stages.setdefault(name, []).append(spent)
    row = Row('frame', 'tracked frame, 1280x720, defaults', median(total[1:]))
    return [row], {
        'stages_ms': {name: median(times) for name, times in stages.items()},
        'frames': len(order), 'published': published, 'machine': peaks(),
    }


def peaks() -> dict[str, float]:
    """Measure memory bandwidth (GB/s) and arithmetic speed (GFLOP/s), each with one thread."""
    big = np.ones(1 << 25, np.float32)
    other = np.empty_like(big)
    a = np.ones((1024, 1024), np.float32)
    copy = min(_seconds(lambda: np.copyto(other, big)) for _ in range(5))
    product = min(_seconds(lambda: a @ a) for _ in range(5))
    return {
        'copy_gb_per_s': 2 * big.nbytes / copy * 1e-9,
        'sgemm_gflop_per_s': 2 * 1024**3 / product * 1e-9,
    }


def _seconds(work: Any) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start
