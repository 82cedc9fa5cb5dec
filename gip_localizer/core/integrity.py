# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Decision whether a match is published.

No single score separates a wrong place from a right one: lane lines still correlate well some
metres further along the road; with many cars even the right place correlates poorly. Several
figures together do (`match_figures`), above all the margin: the fit score of the match
(`Fit.fit_score`), less the share of it that the best other place reaches. The probability of a
right match is a logistic regression on three figures, fitted to trials at right and wrong starts
(`confidence_terms`, written by `make fit-confidence`). Three limits on the margin, on other places
and on the posterior withhold more matches.

"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.confidence import confidence
from gip_localizer.core.confidence_terms import OFFSET, TERMS
from gip_localizer.core.estimate import Match, Status
from gip_localizer.core.match_figures import match_figures
from gip_localizer.core.pose import difference
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.search.search_result import SearchResult
from gip_localizer.parameters import Parameters

# Least margin (no unit) of a match that no earlier fix supports (measured: with the limits below
# it withholds all wrong first matches of 14,000 trials with known truth, docs/accuracy.md).
FIRST_MARGIN = 0.384
# Largest likeness of another place (no unit, 1: equal) with which a match is published (measured:
# wrong poses had 0.75 to 0.78, docs/accuracy.md).
MOST_COMPETITOR = 0.73
# Margin (no unit) above which `integrity.min_winner_mass` does not apply (chosen on the recorded
# trials, docs/accuracy.md, because the lattice does not resolve a mode between its cells).
LARGE_MARGIN = 1.0
# Largest standard deviations of a prior (m, rad) that supports a match near it (design choice:
# 0.15 m and 0.03 rad, because a vaguer prior also contains places that match by chance).
TIGHT_XY, TIGHT_YAW = 0.15, 0.03
# Number of standard deviations of a tight prior within which it supports a match (99.7 % of a
# normal distribution), and what is added to them (m, m, rad; design choice: a cell of 5 cm and
# 0.01 rad, because the errors of odometry are not exactly normal).
SUPPORT_SIGMAS, SUPPORT_SLACK = 3.0, np.array([0.05, 0.05, 0.01])


@dataclass(frozen=True, eq=False)
class Verdict:
    """
    Decision on the result of one search.

    Attributes
    ----------
    status : Status
        TRACKING, or why the match is withheld.
    reason : str
        The reason of the status, in one sentence with numbers.
    fit : Fit or None
        The refined match.
    quality : dict
        Figures of the match by name.
    expected : bool
        The match agrees with a tight prior that earlier fixes confirm.

    """

    status: Status
    reason: str
    fit: Fit | None = None
    quality: dict[str, float] = field(default_factory=dict)
    expected: bool = False


def judge(
    match: Match, found: SearchResult | None, parameters: Parameters, *,
    prior: Belief | None = None,
) -> Verdict:
    """
    Decide whether the match of one search is published.

    Parameters
    ----------
    match : Match
        View and weights of the frame.
    found : SearchResult or None
        Result of the search; None where nothing was searched.
    parameters : Parameters
        The limits of publication.
    prior : Belief or None
        A prior that earlier fixes confirm: a match that agrees with it needs less confidence.

    Returns
    -------
    Verdict
        TRACKING with a fit, or the reason why there is none.

    """
    quality = {'contrast': match.contrast}
    if low := _low_contrast(match, parameters.integrity.min_contrast):
        return Verdict(Status.LOW_CONTRAST, low, quality=quality)
    if found is None:
        return Verdict(Status.OFF_MAP, 'no searched place lies on the map', quality=quality)
    quality['overlap'] = float(found.scores.overlap.max())
    if found.surface is None or not found.fits:
        return Verdict(Status.LOW_OVERLAP, (
            f'at most {quality["overlap"]:.0%} of the view lies on known map cells, below '
            f'score.min_overlap {parameters.score.min_overlap:.0%}'
        ), quality=quality)
    fit = found.fits[0]
    quality.update(match_figures(match, found, parameters.camera_motion))
    expected = prior is not None and _confirmed_by(fit, prior)
    if not expected and found.lies_outside:
        return Verdict(Status.NO_MATCH, (
            f'the match lies {found.distance_outside:.2f} m outside the searched window: the '
            'prior is wrong; give it a larger covariance, or widen search.x and search.y'
        ), fit, quality)
    status, reason = _decide(quality, fit, parameters, expected=expected)
    return Verdict(status, reason, fit, quality, expected=expected)


def _low_contrast(match: Match, least: float) -> str:
    """Return why a view has too little contrast for a match; empty: it has enough."""
    if match.contrast <= 0.0 and not match.weight.any():
        return 'the mask covers the whole view'
    if match.contrast < least:
        return (
            f'contrast {match.contrast:.4f} is below integrity.min_contrast {least:g}: '
            'the frame is flat, dark or saturated'
        )
    return ''


def _confirmed_by(fit: Fit, prior: Belief) -> bool:
    """Return whether a match agrees with a prior that is tight enough to confirm it."""
    sigma = np.sqrt(np.diag(prior.covariance))
    own = np.sqrt(np.maximum(np.diag(prior.own_covariance), 0.0))
    if own[:2].max() > TIGHT_XY or own[2] > TIGHT_YAW:
        return False
    gap = np.abs(difference(fit.pose, prior.pose))
    return bool(np.all(gap < SUPPORT_SIGMAS * sigma + SUPPORT_SLACK))


def _decide(
    quality: dict[str, float], fit: Fit, parameters: Parameters, *, expected: bool
) -> tuple[Status, str]:
    limits = parameters.integrity
    name = 'min_confidence_tracking' if expected else 'min_confidence'
    least = getattr(limits, name)
    if not fit.converged:
        return Status.NO_MATCH, 'the refinement did not converge'
    if not quality['confidence'] >= least:
        return _too_little_confidence(quality, fit, f'integrity.{name} {least:g}', least)
    if withheld := _other_places(quality, expected=expected):
        return withheld
    if fit.overlap < parameters.score.min_overlap:
        return Status.LOW_OVERLAP, f'only {fit.overlap:.0%} of the view lies on known map cells'
    if quality['winner_mass'] < limits.min_winner_mass and quality['margin'] < LARGE_MARGIN:
        return Status.AMBIGUOUS, (
            f'the best mode has {quality["winner_mass"]:.0%} of the probability, below '
            f'integrity.min_winner_mass {limits.min_winner_mass:.0%}'
        )
    sigma_xy = math.hypot(quality['sigma_ahead_m'], quality['sigma_left_m'])
    if sigma_xy > limits.max_sigma_xy or quality['sigma_yaw_rad'] > limits.max_sigma_yaw:
        return Status.UNCERTAIN, (
            f'standard deviations {sigma_xy:.3f} m and {quality["sigma_yaw_rad"]:.4f} rad exceed '
            'integrity.max_sigma_xy or max_sigma_yaw'
        )
    return Status.TRACKING, f'confidence {quality["confidence"]:.2f}, sigma {sigma_xy:.4f} m'


def _other_places(
    quality: dict[str, float], *, expected: bool
) -> tuple[Status, str] | None:
    """Return why a match is withheld because of other places; None: it is not."""
    if quality['competitor'] > MOST_COMPETITOR:
        return Status.AMBIGUOUS, (
            f'another place matches as well (likeness {quality["competitor"]:.2f}, limit '
            f'{MOST_COMPETITOR:g})'
        )
    if not expected and quality['margin'] < FIRST_MARGIN:
        return Status.NO_MATCH, (
            'the margin of a first match over other places is too small: '
            f'{quality["margin"]:.2f}, limit {FIRST_MARGIN:g}'
        )
    return None


def _too_little_confidence(
    quality: dict[str, float], fit: Fit, limit: str, least: float
) -> tuple[Status, str]:
    """Return whether another place or the match itself causes the low confidence, and why."""
    alone = confidence({**quality, 'margin': fit.fit_score}, OFFSET, TERMS)
    if alone >= least:
        return Status.AMBIGUOUS, (
            'another place in the window matches nearly as well (likeness '
            f'{quality["competitor"]:.2f}): confidence {below(quality["confidence"], least)} is '
            f'below {limit}, without it {alone:.2f}'
        )
    figures = ', '.join(f'{term.figure} {quality[term.figure]:.2f}' for term in TERMS)
    return Status.NO_MATCH, (
        f'confidence {below(quality["confidence"], least)} is below {limit} ({figures})'
    )


def below(value: float, limit: float) -> str:
    """Return a value below a limit with as many digits, 2 to 6, as show that it is below."""
    texts = (f'{value:.{digits}f}' for digits in range(2, 7))
    return next((text for text in texts if float(text) < limit), f'{value:.6f}')
