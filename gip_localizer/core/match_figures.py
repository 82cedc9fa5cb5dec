# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of a match: the measures that its confidence is computed from, and those reported."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.confidence import confidence
from gip_localizer.core.confidence_terms import OFFSET, TERMS
from gip_localizer.core.estimate import Match
from gip_localizer.core.match.posterior import independent_cells
from gip_localizer.core.refine.fit import Fit, SAME_PLACE
from gip_localizer.core.search.search_result import SearchResult
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.parameters import CameraMotion


def match_figures(match: Match, found: SearchResult, motion: CameraMotion) -> dict[str, float]:
    """
    Return the figures of the best match by name, `confidence` first.

    Parameters
    ----------
    match : Match
        View and weights of the frame.
    found : SearchResult
        Result of the search, with a surface and at least one fit.
    motion : CameraMotion
        Standard deviations of the suspension.

    """
    assert found.surface is not None
    fit = found.fits[0]
    lattice = float(found.scores.correlation[found.surface.winner])
    competitor = _competitor(found, fit)
    figures = {
        'margin': fit.fit_score * max(1.0 - competitor, 0.0),
        'significance': lattice * math.sqrt(_lattice_cells(match)),
        'sigma_cells': _sigma_cells(fit),
        'suspension': _suspension(fit, motion),
        **_agreement(fit),
        'winner_mass': found.surface.winner_mass,
        'second_ratio': found.surface.second_ratio,
        'lattice_correlation': lattice,
        'competitor': competitor,
        'entropy': found.surface.entropy,
        **_estimated(fit),
    }
    return {'confidence': confidence(figures, OFFSET, TERMS), **figures}


def _agreement(fit: Fit) -> dict[str, float]:
    """Return how well view and map agree at the fit."""
    return {
        'correlation': fit.correlation,
        'overlap': fit.overlap,
        'agreement': fit.agreement,
        'inliers': fit.inliers,
        'overdispersion': fit.overdispersion,
        'chi_sq': fit.chi_sq,
    }


def _estimated(fit: Fit) -> dict[str, float]:
    """Return standard deviations of the pose, the gain, and the suspension of the camera."""
    sigma = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    return {
        'sigma_ahead_m': float(sigma[0]),
        'sigma_left_m': float(sigma[1]),
        'sigma_yaw_rad': float(sigma[2]),
        'gain': fit.gain,
        'pitch_rad': float(fit.camera_motion[0]),
        'roll_rad': float(fit.camera_motion[1]),
        'height_m': float(fit.camera_motion[2]),
    }


def _competitor(found: SearchResult, fit: Fit) -> float:
    """
    Return the likeness of the best other place to the match (1: they cannot be distinguished).

    It is the smaller one of two ratios: of the fit scores, and of the unexplained variances.

    """
    others = [other for other in found.fits[1:] if fit.distance(other) > SAME_PLACE]
    unexplained = fit.residual / fit.gain**2
    return max((
        min(other.fit_score / max(fit.fit_score, 1e-9),
            unexplained / max(other.residual / other.gain**2, 1e-12))
        for other in others
    ), default=0.0)


def _lattice_cells(match: Match) -> float:
    """Return the effective number of independent cells of a view on the lattice of the search."""
    ratio = min(match.view.grid.resolution / SearchWindow.cell, 1.0)
    return independent_cells(match.weight) * ratio**2


def _sigma_cells(fit: Fit) -> float:
    """Return the standard deviation of the position, in cells of the view."""
    own = float(np.trace(fit.own_covariance[:2, :2]))
    return math.sqrt(max(own, 0.0)) / fit.cell


def _suspension(fit: Fit, motion: CameraMotion) -> float:
    """Return the largest of pitch, roll and height change, each in standard deviations."""
    sigmas = (motion.sigma_pitch, motion.sigma_roll, motion.sigma_height)
    return max((
        abs(float(moved)) / sigma
        for sigma, moved in zip(sigmas, fit.camera_motion, strict=True) if sigma > 0.0
    ), default=0.0)
