# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Runs with known errors, for the tests of metrics, results and report."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.run import FrameExhibit, Run, Surface
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.parameters import Parameters

EPOCH = 1_700_000_000_000_000_000
STEP = 100_000_000


@dataclass(frozen=True)
class Frame:
    """What a subscriber of the node knows of a frame."""

    stamp_ns: int
    pose: Pose2 | None
    covariance: NDArray[np.float64] | None = None
    status: str = 'TRACKING'
    reason: str = ''
    quality: Mapping[str, float] = field(default_factory=dict)
    timings_ms: Mapping[str, float] = field(default_factory=dict)


def circle(count: int) -> Trajectory:
    angle = 0.05 * np.arange(count)
    poses = np.stack([10 * np.cos(angle), 10 * np.sin(angle), angle + np.pi / 2], axis=1)
    poses[:, 2] = (poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
    return Trajectory(EPOCH + STEP * np.arange(count, dtype=np.int64), poses)


def noisy_run(count: int = 60, *, seed: int = 5, scale: float = 1.0, withheld: int = 0,
              **changes: Any) -> Run:
    """Estimates whose errors follow the reported covariance times scale²."""
    rng = np.random.default_rng(seed)
    truth = circle(count)
    frames = [
        Frame(int(stamp), None, status='LOST', reason='no match')
        for stamp in truth.stamps_ns[:withheld]
    ]
    for stamp, pose in zip(truth.stamps_ns[withheld:], truth.poses[withheld:], strict=True):
        root = rng.normal(size=(3, 3)) * [0.01, 0.01, 0.002] + np.diag([0.02, 0.02, 0.004])
        error = scale * root @ rng.normal(size=3)
        frames.append(Frame(
            int(stamp), Pose2(*(pose + error)), root @ root.T, quality={'correlation': 0.9},
            timings_ms={'birdseye': 2.0, 'match': 4.0, 'total': float(rng.uniform(6.0, 9.0))},
        ))
    grey = (rng.random((300, 300)) * 255).astype(np.uint8)
    exhibit = FrameExhibit('frame at 1.0 s', EPOCH, {
        'camera image': grey[:60, :80], 'colour': np.zeros((5, 5, 3), np.uint8),
        'score surface': Surface(np.where(np.eye(9) > 0, np.nan, 1.0), 0.45, 0.45, 0.5),
    }, why='Rank 1 of 1.')
    settings: dict[str, Any] = {
        'title': 'A <run>', 'estimates': frames, 'parameters': Parameters(), 'truth': truth,
        'raster_map': RasterMap(grey, 0.1, Pose2(-15.0, -15.0, 0.0)), 'exhibits': [exhibit],
        'wall_seconds': 2.0, 'sources': {'bag': 'bags/demo'},
    }
    return Run(**(settings | changes))
