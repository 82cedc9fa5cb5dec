# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where refinements start: the modes of the lattice's posterior."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

from gip_localizer.core.match.posterior import PosteriorSurface, subcell_peak
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2

MOST_COMPETITORS = 2  # competitors that are always refined; chosen
COMPETITOR_SHARE = 0.6  # least share of the best lattice correlation of a competitor
NEAR_TIE_SHARE, MOST_NEAR_TIES = 0.9, 6  # the same of a near tie, and how many are refined
COMPETITOR_DISTANCE = 0.3  # m, least distance of a competitor from the winner


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A mode of the lattice's posterior."""

    scores: Scores
    surface: PosteriorSurface
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


def competitors(hypotheses: list[Hypothesis], winner: Pose2) -> list[Hypothesis]:
    """
    Return places that look nearly as good on the lattice as the winner: two, or more near ties.

    The posterior cannot decide it: it does not know what the lattice's coarse cells cost a place
    that lies between them.

    """
    best = max(start.correlation for start in hypotheses)
    found: list[Hypothesis] = []
    for start in hypotheses:
        others = [winner, *(other.pose for other in found)]
        apart = [math.hypot(start.pose.x - p.x, start.pose.y - p.y) for p in others]
        if start.correlation > COMPETITOR_SHARE * best and min(apart) > COMPETITOR_DISTANCE:
            found.append(start)
    near_ties = [other for other in found if other.correlation > NEAR_TIE_SHARE * best]
    return list(dict.fromkeys(found[:MOST_COMPETITORS] + near_ties[:MOST_NEAR_TIES]))
