# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Search of one window: pitch by pitch, mode by mode, until one fit is clearly the best."""

from __future__ import annotations

from collections.abc import Callable

from gip_localizer.core.match.posterior import modes, PosteriorSurface
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.search.expected_fit import ExpectedFit
from gip_localizer.core.search.hypotheses import competitors, Hypothesis
from gip_localizer.core.search.search_result import SearchResult

# Largest number of peaks of a score surface that are considered (design choice: 8, because places
# that match by chance are rarely more).
PEAKS = 8
# Least fit score (no unit) and largest overdispersion (no unit) of a clear winner, after which no
# other mode is refined (design choice: 1 and 2.2, because fits at wrong places have lower scores
# or contradict themselves).
CLEAR_WINNER, CLEAR_DISPERSION = 1.0, 2.2
# Offsets (m) along the least constrained direction from which a doubtful fit is repeated (design
# choice: 0.2 m, because on a curve with worn paint a wrong optimum was 0.17 m off).
RESTART_OFFSETS = (-0.2, 0.2)
# Least anisotropy (no unit) of a fit that is repeated from these offsets (design choice: 3,
# because the optimum of an isotropic fit is unique within its basin).
MIN_ANISOTROPY = 3.0
# Pitch (rad) and fit score (no unit) up to and from which the camera is assumed at its calibrated
# pitch (design choice: 0.002 rad and 0.5, because other pitches take more time than they improve).
LEVEL_PITCH, LEVEL_SCORE = 0.002, 0.5
# Least log posterior (no unit) relative to the winner's at which a mode is refined (design choice:
# -40, because the posterior of coarse cells cannot err by more).
MIN_LOG_POSTERIOR = -40.0


class WindowSearch:
    """
    Search of one window: scores its modes, and refines them until one is clearly the best.

    Parameters
    ----------
    scored : callable
        Returns scores and posterior of the window for a pitch of the camera, rad.
    refine : callable
        Refines a pose and a pitch.
    refine_near : callable or None
        Refines a pose near the optimum in less time; its fit is used if it is a clear winner.
    refine_uneven : callable or None
        Refines a pose and a pitch under a light that varies over the road. It is tried where
        uniform light leaves a contradiction, and used from then on if it fits better.
    expected : ExpectedFit or None
        A fit of `refine_near` that meets it ends the search.

    """

    def __init__(
        self, scored: Callable[[float], tuple[Scores, PosteriorSurface | None]],
        refine: Callable[..., Fit], refine_near: Callable[..., Fit] | None,
        refine_uneven: Callable[..., Fit] | None, expected: ExpectedFit | None = None,
    ) -> None:
        self._scored, self._refine, self._refine_near = scored, refine, refine_near
        self._refine_uneven, self._uneven = refine_uneven, False
        self._expected = expected
        self._found: Fit | None = None
        self._scores: list[Scores] = []
        self._hypotheses: list[Hypothesis] = []
        self._fits: dict[Hypothesis | Pose2, Fit] = {}

    def score(self, pitch: float) -> None:
        """Score the lattice for a pitch and keep its modes."""
        scores, surface = self._scored(pitch)
        self._scores.append(scores)
        if surface is not None:
            places = modes(surface, PEAKS)
            self._hypotheses += [Hypothesis(scores, surface, place, pitch) for place in places]
            self._hypotheses.sort(key=lambda start: start.residual)

    def refine(self, most: int) -> None:
        """Refine the best modes, `most` at most, until one is a clear winner."""
        likely = [start for start in self._hypotheses if start.log_posterior > MIN_LOG_POSTERIOR]
        any(_is_clear_winner(self._fit(start)) for start in likely[:most])

    def find_expected(self) -> bool:
        """
        Refine the best mode near its optimum; return whether it is the expected fit.

        Otherwise the fit is kept if it is a clear winner, or the better one under uneven light.

        """
        if not self._hypotheses or self._refine_near is None:
            return False
        start = self._hypotheses[0]
        near = found = self._refine_near(start.pose, pitch=start.pitch)
        if not self._is_expected(near):
            found = self._with_better_light(near, start)
            if not self._is_expected(found):
                if _is_clear_winner(found) or found is not near:
                    self._fits[start] = found
                return False
        self._found = found
        return True

    def _is_expected(self, fit: Fit) -> bool:
        return self._expected is not None and self._expected.is_met_by(fit)

    def is_level(self) -> bool:
        """Return whether the best mode fits well with the camera near its calibrated pitch."""
        if not self._hypotheses:
            return False
        start = self._hypotheses[0]
        fit = self._fit(start)
        level = bool(abs(fit.camera_motion[0]) < LEVEL_PITCH)
        return _is_clear_winner(fit) or (level and fit.fit_score > LEVEL_SCORE)

    def expected_result(self) -> SearchResult:
        """Return the result with the expected fit alone."""
        assert self._found is not None
        best = self._hypotheses[0]
        return SearchResult(best.scores, best.surface, [self._found], compared=False)

    def result(self) -> SearchResult:
        """Refine a doubtful winner from both sides, and its competitors; return the result."""
        if not self._fits:
            return SearchResult(self._scores[0], None, [])
        best = self._best()
        if self._may_be_one_of_several(best):
            for distance in RESTART_OFFSETS:
                start_pose = best.pose @ best.along_weakest(distance)
                self._fits[start_pose] = self._refine(start_pose)
            best = self._best()
        for start in competitors(self._hypotheses, best.pose):
            self._fit(start)
        fits = sorted(self._fits.values(), key=lambda fit: -fit.fit_score)
        return SearchResult(self._hypotheses[0].scores, self._hypotheses[0].surface, fits)

    def _may_be_one_of_several(self, best: Fit) -> bool:
        """Return whether a fit may be one of several optima near each other."""
        if best.fit_score <= CLEAR_WINNER:
            return False
        if self._refine_near is None and best.anisotropy > MIN_ANISOTROPY:
            return True
        light_explains = self._uneven and self._refine_near is not None
        return not (_is_clear_winner(best) or light_explains)

    def _fit(self, start: Hypothesis) -> Fit:
        if start not in self._fits:
            fit = self._refine(start.pose, pitch=start.pitch)
            self._fits[start] = self._with_better_light(fit, start)
        return self._fits[start]

    def _with_better_light(self, fit: Fit, start: Hypothesis) -> Fit:
        """Refine the best hypothesis again under uneven light; the others use the better light."""
        best = start is self._hypotheses[0]
        if self._refine_uneven is None or not best or _is_clear_winner(fit):
            return fit
        other = self._refine_uneven(start.pose, pitch=start.pitch)
        self._uneven = other.fit_score > fit.fit_score
        if self._uneven:
            self._refine = self._refine_uneven
        self._refine_uneven = None
        return other if self._uneven else fit

    def _best(self) -> Fit:
        return max(self._fits.values(), key=lambda fit: fit.fit_score)


def _is_clear_winner(fit: Fit) -> bool:
    return fit.fit_score > CLEAR_WINNER and fit.overdispersion < CLEAR_DISPERSION
