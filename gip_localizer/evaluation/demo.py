# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Bounds of the demo, and the messages that its observer received over the middleware."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.estimate import Status
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.evaluation.metrics import look_up
from gip_localizer.io.trajectory import Trajectory

NO_ANSWER = 'NO_POSE'
"""Status of a frame without a pose of which the diagnostics say nothing: it may be lost on its
way."""
STATUSES = {str(status) for status in Status}
OUTPUT_WITHHELD = 'WITHHELD: '
"""Rule of the diagnostic group `output` before the status of a frame."""


class DemoBound(NamedTuple):
    """A metric of `metrics.json` with its least and its largest allowed value."""

    figure: str
    least: float | None
    most: float | None


BOUNDS = (  # chosen, far above the errors of a correct localizer on a rendered road
    DemoBound('availability', 0.95, None),
    DemoBound('rmse_xy_m', None, 0.03),
    DemoBound('rmse_yaw_deg', None, 0.2),
    DemoBound('wrong_published', None, 0.0),
)


def missed_bounds(metrics: Mapping[str, Any]) -> list[str]:
    """Return a line for each bound that a run misses; an unknown metric misses its bound."""
    missed = []
    for bound in BOUNDS:
        value = look_up(metrics, bound.figure)
        low = bound.least is not None and (value is None or value < bound.least)
        high = bound.most is not None and (value is None or value > bound.most)
        if low or high:
            demand = f'>= {bound.least:g}' if bound.least is not None else f'<= {bound.most:g}'
            found = 'unknown' if value is None else f'{value:.4g}'
            missed.append(f'{bound.figure} is {found}, required {demand}')
    return missed


def overload(metrics: Mapping[str, Any], rate: float) -> str:
    """Return a warning if the latency exceeds the period of the images (rate in 1/s), else ''."""
    latency = look_up(metrics, 'latency_ms.p95')
    if latency is None or latency * rate <= 1000.0:
        return ''
    return (
        f'the machine is overloaded: latency up to {latency:.0f} ms (95th percentile), but an '
        f'image every {1000.0 / rate:.0f} ms; stop other programs, or lower --rate'
    )


@dataclass(frozen=True)
class ReceivedFrame:
    """One frame as received by a subscriber; pose None if no pose was received."""

    stamp_ns: int
    pose: Pose2 | None
    covariance: NDArray[np.float64] | None
    status: str
    reason: str = ''
    quality: Mapping[str, float] = field(default_factory=dict)
    timings_ms: Mapping[str, float] = field(default_factory=dict)


@dataclass
class ReceivedMessages:
    """
    Messages received over the middleware, by the stamp of their image.

    Attributes
    ----------
    truth : dict
        Stamp (ns) to ground truth; one for every frame that the camera published.
    poses : dict
        Stamp (ns) to pose, covariance (3, 3) and latency (ms).
    diagnostics : list
        Stamp (ns) and message of each change of the diagnostics.

    """

    truth: dict[int, Pose2] = field(default_factory=dict)
    poses: dict[int, tuple[Pose2, NDArray[np.float64], float]] = field(default_factory=dict)
    diagnostics: list[tuple[int, str]] = field(default_factory=list)

    def error_m(self, stamp: int) -> float | None:
        """Return the position error of a frame, metres; None if pose or truth is not known."""
        if stamp not in self.poses or stamp not in self.truth:
            return None
        apart = difference(self.poses[stamp][0], self.truth[stamp])
        return float(np.hypot(apart[0], apart[1]))

    def newest_error_m(self) -> float | None:
        """Return the position error of the newest pose, metres."""
        errors = (self.error_m(stamp) for stamp in reversed(self.poses))
        return next((error for error in errors if error is not None), None)

    def latency_ms(self) -> float | None:
        """Return the median latency of the poses, milliseconds."""
        latencies = [latency for _, _, latency in self.poses.values()]
        return float(np.median(latencies)) if latencies else None

    def frames(self) -> list[ReceivedFrame]:
        """Return every frame that the camera published, in order, with or without a pose."""
        return [self._frame(stamp) for stamp in sorted(self.truth)]

    def trajectory(self) -> Trajectory:
        """Return the ground truth."""
        return Trajectory.from_samples(sorted(self.truth.items()))

    def _frame(self, stamp: int) -> ReceivedFrame:
        if stamp not in self.poses:
            reasons = (message for when, message in self.diagnostics if when >= stamp)
            return ReceivedFrame(stamp, None, None, *_status_and_reason(next(reasons, '')))
        pose, covariance, latency = self.poses[stamp]
        return ReceivedFrame(
            stamp, pose, covariance, str(Status.TRACKING), timings_ms={'total': latency}
        )


def _status_and_reason(message: str) -> tuple[str, str]:
    """Return the status that a message of the group `output` begins with, and the rest."""
    word, _, reason = message.removeprefix(OUTPUT_WITHHELD).partition(': ')
    if word in STATUSES:
        return word, reason
    return NO_ANSWER, message or 'neither a pose nor a diagnostic message of this frame arrived'
