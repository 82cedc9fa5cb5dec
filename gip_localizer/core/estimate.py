# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The outcome of one frame."""

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
    """Outcome of a frame; only TRACKING publishes a pose."""

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
        """Return the word itself."""
        return self.value


@dataclass(frozen=True, eq=False)
class Match:
    """
    How the frame was matched: material for pictures and diagnostics.

    Attributes
    ----------
    view : View
        Bird's-eye view.
    weight : (rows, cols) float32
        The Gramian's diagonal.
    scores : Scores or None
        Score surface, where one was computed.
    fit : Fit or None
        The refined winner: the raw single-frame measurement.

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
    Outcome of one frame.

    Attributes
    ----------
    stamp_ns : int
        Stamp of the image, nanoseconds.
    status : Status
        TRACKING with a pose, any other without.
    reason : str
        Why, in one sentence with numbers.
    pose : Pose2 or None
        Base in map; None where the frame gives none.
    covariance : (3, 3) float64 or None
        Of x, y (m) and yaw (rad), map axes.
    quality : dict
        Figures that the decision is made from, by name.
    timings_ms : dict
        Milliseconds per stage.
    match : Match or None
        How the frame was matched.

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
        """Whether the frame gives a pose."""
        return self.pose is not None
