# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether a match is believed, and the figures that decide it.

No single score of a match tells a wrong place from a poor one: lines alone correlate well a lamp
post further on, and a crowded road poorly at the right place. How far a match is ahead of the best
one elsewhere tells them apart: by the share of the road that agrees and how much likelier the map
makes it (`Fit.fit_score`), less what another place reaches of both. With how far the whole view
correlates beyond chance it gives the confidence, by a logistic regression over rendered frames at
right and wrong places, on rich and poor texture, behind cars, by day and night, with exact and
noisy maps. Other figures of a match told no more beside these two.

"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np

from gip_localizer.core.belief import Belief
from gip_localizer.core.estimate import Match, Status
from gip_localizer.core.match.posterior import independent_cells
from gip_localizer.core.pose import difference
from gip_localizer.core.refine.fit import Fit, SAME_PLACE
from gip_localizer.core.search.local_search import SearchResult
from gip_localizer.parameters import CameraMotion, Parameters

TIGHT_XY, TIGHT_YAW = 0.15, 0.03  # m, rad: standard deviations of a prior that may vouch
CONFIDENCE_OFFSET = 6.1
CONFIDENCE_MARGIN = 3.3  # per natural logarithm of the margin over the best other place
CONFIDENCE_SIGNIFICANCE = 3.4  # per natural logarithm
LEAST_MARGIN = 0.01
FIRST_MARGIN = 0.384  # that a match which no earlier fix vouches for must have
FAR_AHEAD = 1.0  # margin from which the lattice is not asked, which is blind between its cells
SIGNIFICANT = 20.0  # standard deviations of chance correlation, beyond which they tell no more
MOST_OVERDISPERSION = 4.5  # from which the parts of the view contradict each other
VAGUE = (1.2, 0.3)  # overdispersion, cells of standard deviation: no right match exceeds both
MOST_SUSPENSION = 10.0  # of camera_motion's standard deviations, from which a match is made to fit
MOST_COMPETITOR = 0.73  # likeness of a match at another place from which neither is believed


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


def confidence(margin: float, lattice_correlation: float, cells: float) -> float:
    """
    Probability that a match is at the right place.

    Parameters
    ----------
    margin : float
        Merit of the match (`Fit.fit_score`), less the share of it that another place reaches.
    lattice_correlation : float
        Of the whole view with the map, at the best candidate of the lattice.
    cells : float
        Independent cells of the view: chance correlates like one over their root.

    """
    significance = max(lattice_correlation, 0.01) * math.sqrt(cells) / SIGNIFICANT
    evidence = (
        CONFIDENCE_OFFSET + CONFIDENCE_MARGIN * math.log(min(max(margin, LEAST_MARGIN), 1.0))
        + CONFIDENCE_SIGNIFICANCE * math.log(min(significance, 1.0))
    )
    return 1.0 / (1.0 + math.exp(-evidence))


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
    cells = independent_cells(match.weight)
    quality.update(_figures(found, fit, cells))
    expected = prior is not None and _agrees(fit, prior)
    oddity = None
    if not expected:
        oddity = _oddity(found, parameters.camera_motion)
    if oddity:
        quality['confidence'] = 0.0
        return Verdict(Status.NO_MATCH, oddity, fit, quality)
    status, reason = _decide(quality, fit, cells, parameters, expected=expected)
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
    """Likeness of the best other place: as much agrees, and no worse (1: cannot be told apart)."""
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


def _figures(found: SearchResult, fit: Fit, cells: float) -> dict[str, float]:
    assert found.surface is not None
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    lattice = float(found.scores.correlation[found.surface.winner])
    competitor = _competitor(found, fit)
    margin = fit.fit_score * max(1.0 - competitor, 0.0)
    return {
        'confidence': confidence(margin, lattice, cells),
        'margin': margin,
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


def _decide(
    quality: dict[str, float], fit: Fit, cells: float, parameters: Parameters, *, expected: bool
) -> tuple[Status, str]:
    limits = parameters.integrity
    name = 'min_confidence_tracking' if expected else 'min_confidence'
    least = getattr(limits, name)
    if not fit.converged:
        return Status.NO_MATCH, 'the refinement did not converge'
    unmatched = confidence(fit.fit_score, quality['lattice_correlation'], cells) >= least
    if quality['competitor'] > MOST_COMPETITOR and unmatched:
        return Status.AMBIGUOUS, (
            f'another place in the window matches as well (likeness {quality["competitor"]:.2f}, '
            f'limit {MOST_COMPETITOR:g})'
        )
    if not quality['confidence'] >= least:
        return Status.NO_MATCH, (
            f'confidence {quality["confidence"]:.2f} is below integrity.{name} {least:g} '
            f'(margin over other places {quality["margin"]:.2f}, correlation of the view '
            f'{quality["lattice_correlation"]:.2f}, {fit.agreement:.0%} of the road agrees)'
        )
    if not expected and quality['margin'] < FIRST_MARGIN:
        return Status.NO_MATCH, (
            'a first match must be farther ahead of other places: margin '
            f'{quality["margin"]:.2f}, limit {FIRST_MARGIN:g}'
        )
    if fit.overlap < parameters.score.min_overlap:
        return Status.LOW_OVERLAP, (
            f'only {fit.overlap:.0%} of the view lies on known map cells'
        )
    if quality['winner_mass'] < limits.min_winner_mass and quality['margin'] < FAR_AHEAD:
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


def _oddity(found: SearchResult, motion: CameraMotion) -> str | None:
    """Say what speaks against a match that no earlier fix vouches for."""
    fit = found.fits[0]
    if fit.overdispersion > MOST_OVERDISPERSION:
        return (
            f'the parts of the view contradict each other: overdispersion '
            f'{fit.overdispersion:.1f}, limit {MOST_OVERDISPERSION:g}'
        )
    sigma = math.sqrt(float(np.trace((fit.covariance - fit.smooth)[:2, :2])))
    if fit.overdispersion > VAGUE[0] and sigma > VAGUE[1] * fit.cell:
        return (
            f'the parts of the view contradict each other (overdispersion '
            f'{fit.overdispersion:.1f}) and place it to {sigma:.3f} m only, more than '
            f'{VAGUE[1]:g} cells of {fit.cell:g} m'
        )
    if found.lies_beyond:
        return (
            f'the match lies {found.beyond:.2f} m outside the window that was searched: the prior '
            'is off; give it a larger covariance, or widen search.x and search.y'
        )
    return _moved_too_far(fit, motion)


def _moved_too_far(fit: Fit, motion: CameraMotion) -> str | None:
    """Say so where the match needs the camera to stand far from its calibration."""
    sigmas = {'sigma_pitch': motion.sigma_pitch, 'sigma_roll': motion.sigma_roll,
              'sigma_height': motion.sigma_height}
    for (name, sigma), moved in zip(sigmas.items(), fit.camera_motion, strict=True):
        if sigma > 0.0 and abs(moved) > MOST_SUSPENSION * sigma:
            return (
                f'the view fits the map only with the camera {moved:+.4f} off its calibrated '
                f'{name.removeprefix("sigma_")}, {abs(moved) / sigma:.0f} times camera_motion.'
                f'{name} {sigma:g}: a wrong place, or a calibration to be checked'
            )
    return None
