# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where refinements start: the modes of the lattice's posterior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

from gip_localizer.core.match.posterior import subcell_peak, Surface
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2

MOST_RIVALS = 2
RIVAL_SHARE = 0.6  # of the best correlation on the lattice, from which a place is a rival, ...
TWIN_SHARE, MOST_TWINS = 0.9, 6  # ... and a twin, of which more are looked at
RIVAL_DISTANCE = 0.3  # m from the winner


@dataclass(frozen=True, eq=False)
class Start:
    """A mode of the lattice's posterior."""

    scores: Scores
    surface: Surface
    index: tuple[int, int, int]
    pitch: float

    @property
    def residual(self) -> float:
        return float(self.scores.residual[self.index])

    @property
    def log_posterior(self) -> float:
        return float(self.surface.log_posterior[self.index])

    @property
    def correlation(self) -> float:
        return float(self.scores.correlation[self.index])

    @cached_property
    def pose(self) -> Pose2:
        return self.scores.lattice.pose(subcell_peak(self.surface, self.index))


def rivals(starts: list[Start], winner: Pose2) -> list[Start]:
    """
    Places that look nearly as good on the lattice as the winner: two, or more if they are twins.

    The posterior cannot tell: it knows nothing of what the lattice's coarse cells cost a place
    that lies between them.

    """
    best = max(start.correlation for start in starts)
    rivals: list[Start] = []
    for start in starts:
        others = [winner, *(rival.pose for rival in rivals)]
        apart = [math.hypot(start.pose.x - p.x, start.pose.y - p.y) for p in others]
        if start.correlation > RIVAL_SHARE * best and min(apart) > RIVAL_DISTANCE:
            rivals.append(start)
    twins = [rival for rival in rivals if rival.correlation > TWIN_SHARE * best]
    return list(dict.fromkeys(rivals[:MOST_RIVALS] + twins[:MOST_TWINS]))
