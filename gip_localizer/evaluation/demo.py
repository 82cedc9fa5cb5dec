# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What the demo demands of the localizer, and what it heard of it over the middleware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.pose import difference, Pose2
from gip_localizer.evaluation.metrics import look_up
from gip_localizer.io.trajectory import Trajectory

PUBLISHED, WITHHELD = 'published', 'withheld'


class Bound(NamedTuple):
    """A figure of `metrics.json` and what it must not pass."""

    figure: str
    least: float | None
    most: float | None


BOUNDS = (
    Bound('availability', 0.95, None),
    Bound('rmse_xy_m', None, 0.03),
    Bound('rmse_yaw_deg', None, 0.2),
    Bound('wrong_published', None, 0.0),
)


def missed_bounds(metrics: Mapping[str, Any]) -> list[str]:
    """Return a line for each demand that a run misses; an unknown figure misses its own."""
    missed = []
    for bound in BOUNDS:
        value = look_up(metrics, bound.figure)
        low = bound.least is not None and (value is None or value < bound.least)
        high = bound.most is not None and (value is None or value > bound.most)
        if low or high:
            demand = f'>= {bound.least:g}' if bound.least is not None else f'<= {bound.most:g}'
            found = 'unknown' if value is None else f'{value:.4g}'
            missed.append(f'{bound.figure} is {found}, demanded {demand}')
    return missed


def overload(metrics: Mapping[str, Any], rate: float) -> str:
    """Tell that poses took longer than images (1/s) left for them; empty where they did not."""
    latency = look_up(metrics, 'latency_ms.p95')
    if latency is None or latency * rate <= 1000.0:
        return ''
    return (
        f'the machine did not keep up: latency up to {latency:.0f} ms (95th percentile) and an '
        f'image every {1000.0 / rate:.0f} ms; close what else runs on it, or lower --rate'
    )


@dataclass(frozen=True)
class HeardFrame:
    """One frame as a subscriber saw it; pose None: none came for it."""

    stamp_ns: int
    pose: Pose2 | None
    covariance: NDArray[np.float64] | None
    status: str
    reason: str = ''
    quality: Mapping[str, float] = field(default_factory=dict)
    timings_ms: Mapping[str, float] = field(default_factory=dict)


@dataclass
class Hearing:
    """
    Collects what comes over the middleware, by the stamp of the image.

    Attributes
    ----------
    truth : dict
        Stamp (ns) to ground truth; one for every frame that the camera sent.
    poses : dict
        Stamp (ns) to pose, covariance (3, 3) and latency (ms).
    sayings : list
        Stamp (ns) and message of each change in the diagnostics.

    """

    truth: dict[int, Pose2] = field(default_factory=dict)
    poses: dict[int, tuple[Pose2, NDArray[np.float64], float]] = field(default_factory=dict)
    sayings: list[tuple[int, str]] = field(default_factory=list)

    def error_m(self) -> float | None:
        """Return the distance of the newest pose from the truth, metres."""
        for stamp in reversed(self.poses):
            if stamp in self.truth:
                apart = difference(self.poses[stamp][0], self.truth[stamp])
                return float(np.hypot(apart[0], apart[1]))
        return None

    def latency_ms(self) -> float | None:
        """Return the median latency of the poses, milliseconds."""
        latencies = [latency for _, _, latency in self.poses.values()]
        return float(np.median(latencies)) if latencies else None

    def frames(self) -> list[HeardFrame]:
        """Return every frame that the camera sent, in order, with its pose or without."""
        return [self._frame(stamp) for stamp in sorted(self.truth)]

    def trajectory(self) -> Trajectory:
        """Return the ground truth."""
        return Trajectory.from_samples(sorted(self.truth.items()))

    def _frame(self, stamp: int) -> HeardFrame:
        if stamp not in self.poses:
            said = (message for when, message in self.sayings if when >= stamp)
            return HeardFrame(stamp, None, None, WITHHELD, next(said, ''))
        pose, covariance, latency = self.poses[stamp]
        return HeardFrame(stamp, pose, covariance, PUBLISHED, timings_ms={'total': latency})
