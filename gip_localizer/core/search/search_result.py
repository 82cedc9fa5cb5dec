# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Result of a search in one window, and the second search around a fit outside the window."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from gip_localizer.core.match.posterior import PosteriorSurface
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.fit import Fit

# Largest distance (m) of a match from the searched window (design choice: 0.05 m, because the
# refinement may leave the outermost cell of the lattice by its own error).
MAX_OUTSIDE = 0.05


@dataclass(frozen=True, eq=False)
class SearchResult:
    """
    Result of a search in one window.

    Attributes
    ----------
    scores : Scores
        Scores of the candidates on the lattice.
    surface : PosteriorSurface or None
        Posterior of the candidates; None if no candidate overlaps the map enough.
    fits : list of Fit
        Refined modes, best first.
    compared : bool
        The best fit was compared with the other modes; False where it was expected.

    """

    scores: Scores
    surface: PosteriorSurface | None
    fits: list[Fit]
    compared: bool = True

    def with_fits(self, fits: list[Fit]) -> SearchResult:
        """Return the result with the fits of another search."""
        return replace(self, fits=sorted([*self.fits, *fits], key=lambda fit: -fit.fit_score))

    @property
    def distance_outside(self) -> float:
        """Distance of the best fit from the window, metres; negative inside."""
        lattice = self.scores.lattice
        offset = difference(lattice.anchor.inverse() @ self.fits[0].pose, Pose2(0.0, 0.0, 0.0))
        return float(max(abs(offset[0]) - lattice.half[0] * lattice.step,
                         abs(offset[1]) - lattice.half[1] * lattice.step))

    @property
    def lies_outside(self) -> bool:
        """Whether the best fit lies outside the window, so that no other place was compared."""
        return bool(self.fits) and self.distance_outside > MAX_OUTSIDE


def around_winner(
    found: SearchResult | None, search: Callable[[Pose2], SearchResult | None]
) -> SearchResult | None:
    """
    Return a result; if its best fit lies outside the window, search again around this fit.

    The fits of the first search are kept: on repeated ground they include the equal places.

    """
    if found is None or not found.lies_outside:
        return found
    again = search(found.fits[0].pose)
    return again.with_fits(found.fits) if again is not None and again.fits else again
