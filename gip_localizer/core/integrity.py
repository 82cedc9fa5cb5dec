# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether a match is believed, and the figures that decide it.

No single score separates a wrong place from a right one: lane lines still correlate well some
metres further along the road; with many cars even the right place correlates poorly. Several
figures together do, above all the margin over the best other place: by the share of the road that
agrees and how much likelier the map makes it (`Fit.fit_score`), less what the other place reaches
of both. The probability of a right match is a logistic regression on them, fitted to trials at
right and wrong starts (`confidence_terms`, written by `make fit-confidence`). Three limits on the
margin, on other places and on the posterior withhold further.

"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.confidence import confidence
from gip_localizer.core.confidence_terms import OFFSET, TERMS
from gip_localizer.core.estimate import Match, Status
from gip_localizer.core.match.posterior import independent_cells
from gip_localizer.core.pose import difference
from gip_localizer.core.refine.fit import Fit, SAME_PLACE
from gip_localizer.core.search.local_search import SearchResult
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.parameters import CameraMotion, Parameters

# Limits that only withhold, set on 14,000 trials (docs/accuracy.md), among them all that gave a
# wrong pose: least margin of a match that no earlier fix supports; largest likeness of a match at
# another place; margin from which `integrity.min_winner_mass` does not apply, for the lattice
# that it is read from does not see between its cells.
FIRST_MARGIN = 0.384
MOST_COMPETITOR = 0.73
LARGE_MARGIN = 1.0
# Largest standard deviations of a prior (m, rad) that supports a match near it. Chosen.
TIGHT_XY, TIGHT_YAW = 0.15, 0.03


@dataclass(frozen=True, eq=False)
class Verdict:
    """
    Outcome of judging one search.

    Attributes
    ----------
    status : Status
        TRACKING, or why the match is not believed.
    reason : str
        The same in one sentence with numbers.
    fit : Fit or None
        The refined match.
    quality : dict
        The figures by name.
    expected : bool
        The match lies where a tight prior that earlier fixes support expects it.

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
    Judge one search.

    Parameters
    ----------
    match : Match
        View and weights of the frame.
    found : SearchResult or None
        Outcome of the search; None where there was nothing to search.
    parameters : Parameters
        The limits.
    prior : Belief or None
        A prior that earlier fixes confirm: a match that agrees with it needs less confidence.

    Returns
    -------
    Verdict
        TRACKING with a fit, or why not.

    """
    limits = parameters.integrity
    seen = match.contrast
    quality = {'contrast': seen}
    if seen <= 0.0 and not match.weight.any():
        return Verdict(Status.LOW_CONTRAST, (
            'nothing of the view is looked at: the mask covers all of it'
        ), None, quality)
    if seen < limits.min_contrast:
        return Verdict(Status.LOW_CONTRAST, (
            f'contrast {seen:.4f} is below integrity.min_contrast {limits.min_contrast:g}: '
            'the frame is flat, dark or saturated'
        ), None, quality)
    if found is None:
        return Verdict(
            Status.OFF_MAP, 'no place that was looked at lies on the map', None, quality
        )
    quality['overlap'] = float(found.scores.overlap.max())
    if found.surface is None or not found.fits:
        return Verdict(Status.LOW_OVERLAP, (
            f'at most {quality["overlap"]:.0%} of the view lies on known map cells, below '
            f'score.min_overlap {parameters.score.min_overlap:.0%}'
        ), None, quality)
    fit = found.fits[0]
    quality.update(_figures(found, _lattice_cells(match), parameters.camera_motion))
    expected = prior is not None and _agrees(fit, prior)
    if not expected and found.lies_beyond:
        return Verdict(Status.NO_MATCH, (
            f'the match lies {found.beyond:.2f} m outside the window that was searched: the prior '
            'is off; give it a larger covariance, or widen search.x and search.y'
        ), fit, quality)
    status, reason = _decide(quality, fit, parameters, expected=expected)
    return Verdict(status, reason, fit, quality, expected=expected)


def _agrees(fit: Fit, prior: Belief) -> bool:
    """Whether a match lies where a tight prior expects it."""
    sigma = np.sqrt(np.diag(prior.covariance))
    own = np.sqrt(np.maximum(np.diag(prior.own_covariance), 0.0))
    if own[:2].max() > TIGHT_XY or own[2] > TIGHT_YAW:
        return False
    gap = np.abs(difference(fit.pose, prior.pose))
    return bool(np.all(gap < 3.0 * sigma + np.array([0.05, 0.05, 0.01])))


def _competitor(found: SearchResult, fit: Fit) -> float:
    """Likeness of the best other place: as much agrees, and no worse (1: indistinguishable)."""
    others = [
        other for other in found.fits[1:]
        if fit.distance(other) > SAME_PLACE
    ]
    unexplained = fit.residual / fit.gain**2
    return max((
        min(other.fit_score / max(fit.fit_score, 1e-9),
            unexplained / max(other.residual / other.gain**2, 1e-12))
        for other in others
    ), default=0.0)


def _lattice_cells(match: Match) -> float:
    """Return the effective number of independent cells of a view as the lattice joins them."""
    joined = min(match.view.grid.resolution / SearchWindow.cell, 1.0)
    return independent_cells(match.weight) * joined**2


def _figures(found: SearchResult, cells: float, motion: CameraMotion) -> dict[str, float]:
    assert found.surface is not None
    fit = found.fits[0]
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    own = float(np.trace(fit.own_covariance[:2, :2]))
    lattice = float(found.scores.correlation[found.surface.winner])
    competitor = _competitor(found, fit)
    figures = {
        'margin': fit.fit_score * max(1.0 - competitor, 0.0),
        'significance': lattice * math.sqrt(cells),
        'sigma_cells': math.sqrt(max(own, 0.0)) / fit.cell,
        'suspension': _suspension(fit, motion),
        'correlation': fit.correlation,
        'overlap': fit.overlap,
        'agreement': fit.agreement,
        'inliers': fit.inliers,
        'overdispersion': fit.overdispersion,
        'chi_sq': fit.chi_sq,
        'winner_mass': found.surface.winner_mass,
        'second_ratio': found.surface.second_ratio,
        'lattice_correlation': lattice,
        'competitor': competitor,
        'entropy': found.surface.entropy,
        'sigma_ahead_m': float(sigma[0]),
        'sigma_left_m': float(sigma[1]),
        'sigma_yaw_rad': float(sigma[2]),
        'gain': fit.gain,
        'pitch_rad': float(fit.camera_motion[0]),
        'roll_rad': float(fit.camera_motion[1]),
        'height_m': float(fit.camera_motion[2]),
    }
    return {'confidence': confidence(figures, OFFSET, TERMS), **figures}


def _suspension(fit: Fit, motion: CameraMotion) -> float:
    """Return how far the camera is from its calibration, in standard deviations."""
    sigmas = (motion.sigma_pitch, motion.sigma_roll, motion.sigma_height)
    return max((
        abs(float(moved)) / sigma
        for sigma, moved in zip(sigmas, fit.camera_motion, strict=True) if sigma > 0.0
    ), default=0.0)


def _decide(
    quality: dict[str, float], fit: Fit, parameters: Parameters, *, expected: bool
) -> tuple[Status, str]:
    limits = parameters.integrity
    name = 'min_confidence_tracking' if expected else 'min_confidence'
    least = getattr(limits, name)
    if not fit.converged:
        return Status.NO_MATCH, 'the refinement did not converge'
    if not quality['confidence'] >= least:
        return _disbelieved(quality, fit, f'integrity.{name} {least:g}', least)
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
    if fit.overlap < parameters.score.min_overlap:
        return Status.LOW_OVERLAP, (
            f'only {fit.overlap:.0%} of the view lies on known map cells'
        )
    if quality['winner_mass'] < limits.min_winner_mass and quality['margin'] < LARGE_MARGIN:
        return Status.AMBIGUOUS, (
            f'the best mode holds {quality["winner_mass"]:.0%} of the probability, below '
            f'integrity.min_winner_mass {limits.min_winner_mass:.0%}'
        )
    sigma_xy = math.hypot(quality['sigma_ahead_m'], quality['sigma_left_m'])
    if sigma_xy > limits.max_sigma_xy or quality['sigma_yaw_rad'] > limits.max_sigma_yaw:
        return Status.UNCERTAIN, (
            f'standard deviations {sigma_xy:.3f} m and {quality["sigma_yaw_rad"]:.4f} rad exceed '
            'integrity.max_sigma_xy or max_sigma_yaw'
        )
    return Status.TRACKING, f'confidence {quality["confidence"]:.2f}, sigma {sigma_xy:.4f} m'


def _disbelieved(
    quality: dict[str, float], fit: Fit, limit: str, least: float
) -> tuple[Status, str]:
    """Say whether another place is to blame, or the match itself."""
    alone = confidence({**quality, 'margin': fit.fit_score}, OFFSET, TERMS)
    if alone >= least:
        return Status.AMBIGUOUS, (
            'another place in the window matches nearly as well (likeness '
            f'{quality["competitor"]:.2f}): confidence {quality["confidence"]:.2f} is below '
            f'{limit}, without it {alone:.2f}'
        )
    figures = ', '.join(f'{term.figure} {quality[term.figure]:.2f}' for term in TERMS)
    return Status.NO_MATCH, f'confidence {quality["confidence"]:.2f} is below {limit} ({figures})'
