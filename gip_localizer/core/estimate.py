# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Result of one frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.fit import Fit


class Status(str, Enum):
    """Status of a frame; only TRACKING publishes a pose."""

    TRACKING = 'TRACKING'
    NO_CALIBRATION = 'NO_CALIBRATION'
    BAD_IMAGE = 'BAD_IMAGE'
    FROZEN_IMAGE = 'FROZEN_IMAGE'
    NO_MASK = 'NO_MASK'
    NO_ROAD_IN_VIEW = 'NO_ROAD_IN_VIEW'
    NO_PRIOR = 'NO_PRIOR'
    OUT_OF_ORDER = 'OUT_OF_ORDER'
    LOW_CONTRAST = 'LOW_CONTRAST'
    OFF_MAP = 'OFF_MAP'
    LOW_OVERLAP = 'LOW_OVERLAP'
    NO_MATCH = 'NO_MATCH'
    AMBIGUOUS = 'AMBIGUOUS'
    UNCERTAIN = 'UNCERTAIN'
    CONFIRMING = 'CONFIRMING'
    LOST = 'LOST'
    FAULT = 'FAULT'

    def __str__(self) -> str:
        """Return the name."""
        return self.value


@dataclass(frozen=True, eq=False)
class Match:
    """
    View, scores and fit of the frame, for images and diagnostics.

    Attributes
    ----------
    view : View
        Bird's-eye view.
    weight : (rows, cols) float32
        Weight per cell: the diagonal of the Gramian.
    scores : Scores or None
        Score surface; None if none was computed.
    fit : Fit or None
        The refined match: the measurement of this frame alone.

    """

    view: View
    weight: Floats
    scores: Scores | None = None
    fit: Fit | None = None

    @cached_property
    def contrast(self) -> float:
        """Weighted standard deviation of the view, grey levels of [0, 1]."""
        total = float(self.weight.sum(dtype=np.float64))
        if total <= 0.0:
            return 0.0
        values, weight = self.view.patch.ravel(), self.weight.ravel()
        centred = values - np.float32(weight @ values / total)
        return math.sqrt(max(float(weight @ centred**2) / total, 0.0))


@dataclass(frozen=True, eq=False)
class Estimate:
    """
    Result of one frame.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the image, nanoseconds.
    status : Status
        TRACKING with a pose; any other status without one.
    reason : str
        Reason of the status, in one sentence with numbers.
    pose : Pose2 or None
        Pose of base in map; None if none is published.
    covariance : (3, 3) float64 or None
        Covariance of x, y (m) and yaw (rad), map axes.
    quality : dict
        Figures of the match by name, from which the status is decided.
    timings_ms : dict
        Time per stage, milliseconds.
    match : Match or None
        View, scores and fit; None if the frame was not matched.

    """

    stamp_ns: int
    status: Status
    reason: str
    pose: Pose2 | None = None
    covariance: Floats | None = None
    quality: dict[str, float] = field(default_factory=dict)
    timings_ms: dict[str, float] = field(default_factory=dict)
    match: Match | None = None

    @property
    def published(self) -> bool:
        """Whether a pose is published."""
        return self.pose is not None
