# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Initial poses of the refinement: the modes of the posterior on the lattice."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
import math

from gip_localizer.core.match.posterior import PosteriorSurface, subcell_peak
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2

# Number of competitors that are always refined (design choice: 2, because each takes
# milliseconds).
MOST_COMPETITORS = 2
# Least correlation of a competitor, as a share of the best on the lattice (no unit; design choice:
# 0.6, because weaker places do not come near the fit score of the best).
COMPETITOR_SHARE = 0.6
# Least correlation of a near tie, as the same share (no unit), and largest number of near ties
# that are refined (measured: on repeated ground one of 500 matches was published wrongly with two
# places examined, and none of 400 with up to eight, docs/accuracy.md).
NEAR_TIE_SHARE, MOST_NEAR_TIES = 0.9, 6
# Least distance (m) of a competitor from the winner (design choice: 0.3 m, because nearer modes of
# the lattice lead to the same fit).
COMPETITOR_DISTANCE = 0.3


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A mode of the posterior on the lattice, for one pitch of the camera (rad)."""

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
    Return places with nearly the correlation of the winner: two, or more if they are near ties.

    The posterior cannot exclude them: it does not include the loss of correlation of a place
    between the coarse cells of the lattice.

    """
    best = max(start.correlation for start in hypotheses)
    found: list[Hypothesis] = []
    for start in hypotheses:
        others = [winner, *(other.pose for other in found)]
        distances = [math.hypot(start.pose.x - p.x, start.pose.y - p.y) for p in others]
        if start.correlation > COMPETITOR_SHARE * best and min(distances) > COMPETITOR_DISTANCE:
            found.append(start)
    near_ties = [other for other in found if other.correlation > NEAR_TIE_SHARE * best]
    return list(dict.fromkeys(found[:MOST_COMPETITORS] + near_ties[:MOST_NEAR_TIES]))
