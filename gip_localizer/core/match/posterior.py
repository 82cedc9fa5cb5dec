# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 4: scores and prior → modes, covariance, and whether to believe the winner.

The residuals of the score surface are log-likelihoods up to the noise scale, which the winner's
own residual gives: `log p = -n/2 · R/R_min`, with n the number of independent cells. Normalised
over the window with the prior it is a posterior, whose mass and spread separate a unique match
from an ambiguous one.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.match.peaks import best_peaks, vertex
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import difference, Pose2

# Number of cells per independent cell (design choice: 9, 3 x 3 cells, because texture, blur and
# paint correlate the residuals of neighbours).
CELLS_PER_INDEPENDENT = 9.0
# Half-widths of the winning mode in x and y (m) and in yaw (rad; design choice: 0.2 m and 0.03
# rad, because they contain a peak of the lattice and no other place).
WINNER_RADIUS_M, WINNER_RADIUS_YAW = 0.2, 0.03


@dataclass(frozen=True, eq=False)
class PosteriorSurface:
    """
    The posterior over the window.

    Attributes
    ----------
    log_posterior : (yaws, x, y) float64
        Normalised to a maximum of 0; -inf where the overlap is too small.
    winner : (3,) int
        Index of its maximum.
    winner_mass : float
        Share of the probability within the winner's radius.
    second_ratio : float
        Least residual outside the winner's radius over the winner's (inf: none); below 1 where
        the prior decides.
    covariance : (3, 3) float64
        Spread of the posterior (x, y, yaw) in the anchor's axes.
    entropy : float
        Of the posterior, nats.

    """

    log_posterior: Floats
    winner: tuple[int, int, int]
    winner_mass: float
    second_ratio: float
    covariance: Floats
    entropy: float


def independent_cells(weight: Floats) -> float:
    """Effective number of independent cells under the weights, at least 1."""
    flat = weight.ravel()
    total, squares = float(flat.sum(dtype=np.float64)), float(flat @ flat)
    return max(total**2 / max(squares, 1e-30) / CELLS_PER_INDEPENDENT, 1.0)


def posterior_surface(scores: Scores, cells: float, prior: Belief | None) -> PosteriorSurface:
    """
    Turn a score surface into a posterior.

    Parameters
    ----------
    scores : Scores
        At least one candidate has a finite residual.
    cells : float
        Number of independent cells (`independent_cells`).
    prior : Belief or None
        None: a flat prior over the window.

    Returns
    -------
    PosteriorSurface
        The posterior and what is read off it.

    """
    residual = with_unseen(scores).astype(np.float64)
    floor = max(float(residual.min()), 1e-12)
    log_posterior = -0.5 * cells * (residual / floor - 1.0)
    x, y, yaw = _axes(scores)
    if prior is not None:
        log_posterior = log_posterior + _log_prior(scores, prior)
    log_posterior -= log_posterior.max()
    winner = tuple(int(i) for i in np.unravel_index(log_posterior.argmax(), residual.shape))
    mass = np.exp(log_posterior)
    mass /= mass.sum()
    near = (
        (np.abs(x - x[0, winner[1], 0]) <= WINNER_RADIUS_M)
        & (np.abs(y - y[0, 0, winner[2]]) <= WINNER_RADIUS_M)
        & (np.abs(yaw - yaw[winner[0], 0, 0]) <= WINNER_RADIUS_YAW)
    )
    outside = np.where(near, np.inf, residual).min()
    return PosteriorSurface(
        log_posterior, winner,  # type: ignore[arg-type]
        float(mass[near].sum()), float(outside / max(residual[winner], 1e-12)),
        _spread(mass, x, y, yaw),
        float(-(mass * np.log(np.maximum(mass, 1e-300))).sum()),
    )


def modes(surface: PosteriorSurface, count: int) -> list[tuple[int, int, int]]:
    """Indices of the best separate peaks, best first, at most `count`."""
    return best_peaks(surface.log_posterior, count)


def subcell_peak(surface: PosteriorSurface, index: tuple[int, int, int]) -> Floats:
    """Fractional index (3,) of a peak, by a parabola through its neighbours on each axis."""
    peak = np.array(index, float)
    for axis in range(3):
        low, high = list(index), list(index)
        low[axis] -= 1
        high[axis] += 1
        if low[axis] < 0 or high[axis] >= surface.log_posterior.shape[axis]:
            continue
        values = (-float(surface.log_posterior[tuple(i)]) for i in (low, index, high))
        peak[axis] += vertex(*values)[0]
    return peak


def with_unseen(scores: Scores) -> Floats:
    """
    Residuals in which the weight off the map counts as unexplained.

    Without this a candidate could win by moving the view's misfits off the map. What is
    unexplained leaves a typical candidate's residual.

    """
    residual = scores.residual
    known = np.isfinite(residual)
    if not known.any() or scores.overlap[known].min() > 0.999:
        return residual
    typical = np.median(residual[known][:: max(residual.size // 100_000, 1)])
    unseen = (np.float32(1.0) - scores.overlap) * typical
    explained = scores.overlap * np.where(known, residual, np.float32(0.0))
    return np.asarray(np.where(known, explained + unseen, np.inf))


def _axes(scores: Scores) -> tuple[Floats, Floats, Floats]:
    lattice = scores.lattice
    n_yaw, n_x, n_y = lattice.shape
    x = (lattice.half[0] - np.arange(n_x)) * lattice.step
    y = (lattice.half[1] - np.arange(n_y)) * lattice.step
    return x[None, :, None], y[None, None, :], lattice.yaws.reshape(n_yaw, 1, 1)


def _log_prior(scores: Scores, prior: Belief) -> Floats:
    """Log of the prior's Gaussian over the lattice, in the anchor's axes."""
    x, y, yaw = _axes(scores)
    anchor = scores.lattice.anchor
    turn = np.eye(3)
    turn[:2, :2] = anchor.rotation()
    information = np.linalg.inv(turn.T @ prior.covariance @ turn)
    centre = difference(anchor.inverse() @ prior.pose, Pose2(0.0, 0.0, 0.0))
    x, y, yaw = x - centre[0], y - centre[1], yaw - centre[2]
    (a, b, c), (_, d, e), (*_, f) = information
    return np.asarray(-0.5 * (
        a * x**2 + d * y**2 + f * yaw**2 + 2.0 * (x * (b * y + c * yaw) + e * y * yaw)
    ))


def _spread(mass: Floats, x: Floats, y: Floats, yaw: Floats) -> Floats:
    axes = np.stack([a.ravel() for a in np.broadcast_arrays(x, y, yaw)])
    centred = axes - (axes @ mass.ravel())[:, None]
    return np.asarray((centred * mass.ravel()) @ centred.T)
