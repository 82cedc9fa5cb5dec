# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether a match is believed, and the figures that decide it."""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np

from gip_localizer.core.estimate import Match, Status
from gip_localizer.core.posterior import contrast
from gip_localizer.core.refinement import Fit
from gip_localizer.core.search import Found
from gip_localizer.parameters import Parameters


@dataclass(frozen=True, eq=False)
class Verdict:
    """Status, the reason in words, the refined match, and the figures by name."""

    status: Status
    reason: str
    fit: Fit | None = None
    quality: dict[str, float] = field(default_factory=dict)


def judge(match: Match, found: Found | None, parameters: Parameters) -> Verdict:
    """
    Judge one search.

    Parameters
    ----------
    match : Match
        View and weights of the frame.
    found : Found or None
        Outcome of the search; None where there was nothing to search.
    parameters : Parameters
        The limits.

    Returns
    -------
    Verdict
        TRACKING with a fit, or why not.

    """
    limits = parameters.integrity
    seen = contrast(match.view, match.weight)
    quality = {'contrast': seen}
    if seen < limits.min_contrast:
        return Verdict(Status.LOW_CONTRAST, (
            f'contrast {seen:.4f} is below integrity.min_contrast {limits.min_contrast:g}: '
            'the frame is flat, dark or saturated'
        ), None, quality)
    if found is None:
        return Verdict(Status.OFF_MAP, 'the search window lies off the map', None, quality)
    quality['overlap'] = float(found.scores.overlap.max())
    if found.surface is None or not found.fits:
        return Verdict(Status.LOW_OVERLAP, (
            f'at most {quality["overlap"]:.0%} of the view lies on known map cells, below '
            f'score.min_overlap {parameters.score.min_overlap:.0%}'
        ), None, quality)
    fit = found.fits[0]
    quality.update(_figures(found, fit))
    status, reason = _decide(quality, fit, parameters)
    return Verdict(status, reason, fit, quality)


def _figures(found: Found, fit: Fit) -> dict[str, float]:
    assert found.surface is not None
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    return {
        'correlation': fit.correlation,
        'overlap': fit.overlap,
        'agreement': fit.agreement,
        'inliers': fit.inliers,
        'overdispersion': fit.overdispersion,
        'chi_sq': fit.chi_sq,
        'winner_mass': found.surface.winner_mass,
        'second_ratio': found.surface.second_ratio,
        'lattice_correlation': float(found.scores.correlation[found.surface.winner]),
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
    quality: dict[str, float], fit: Fit, parameters: Parameters
) -> tuple[Status, str]:
    limits = parameters.integrity
    if not fit.converged:
        return Status.NO_MATCH, 'the refinement did not converge'
    if fit.correlation < limits.min_correlation:
        return Status.NO_MATCH, (
            f'correlation {fit.correlation:.2f} is below integrity.min_correlation '
            f'{limits.min_correlation:g}'
        )
    if fit.overlap < parameters.score.min_overlap:
        return Status.LOW_OVERLAP, (
            f'only {fit.overlap:.0%} of the view lies on known map cells'
        )
    if quality['winner_mass'] < limits.min_winner_mass:
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
    return Status.TRACKING, f'correlation {fit.correlation:.2f}, sigma {sigma_xy:.4f} m'
