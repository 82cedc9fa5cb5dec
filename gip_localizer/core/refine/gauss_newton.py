# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Gauss-Newton steps on the cells of one stage, with robust weights and unknown exposure."""

from __future__ import annotations

from functools import partial

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.edge_noise import edge_share
from gip_localizer.core.refine.exposure import exposure, shading
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.local_light import find_light, Light
from gip_localizer.core.refine.map_prediction import MapPrediction
from gip_localizer.core.refine.observation import Layer, RefinementState, Unknowns
from gip_localizer.core.refine.robust import (
    agreeing,
    mean_normalised_square,
    outlier_scale,
    robust_weights,
)

# Number of reweightings of gain and offset before the first step of a stage, and before its other
# steps (design choice: 2 and 1, because the exposure changes little after the first step).
EXPOSURE_ROUNDS = (2, 1)
# Number of additional reweightings in the first stage (design choice: 2, because the exposure is
# unknown before it).
FIRST_ROUNDS = 2
# Step (m, rad) below which the last stage ends (design choice: 0.3 mm and 0.05 mrad, because they
# are smaller than the least errors that were measured, docs/accuracy.md).
DONE_XY, DONE_YAW = 3e-4, 5e-5
# Largest last step of a converged fit, in units of DONE_XY and DONE_YAW (design choice: 8, which
# is 2.4 mm, because a stage may reach its largest number of steps shortly before the end).
CONVERGED = 8.0
# Largest last step of a converged fit, in standard deviations of the result (design choice: 0.5,
# because on poor texture a step of millimetres is far below the standard deviation).
CONVERGED_SIGMAS = 0.5
# Largest step of the pose (m, m, rad; design choice: 0.15 m and 0.03 rad, because a longer step
# may leave the basin of convergence).
MAX_STEP = np.array([0.15, 0.15, 0.03])
# Largest step of pitch, roll and height (rad, rad, m; design choice: 0.03 rad and 0.1 m, because
# the cells must stay on the road that the camera sees).
MAX_SUSPENSION = np.array([0.03, 0.03, 0.1])
# Least gain of the view relative to the map (no unit; design choice: 0.02, because a gain near 0
# would fit any view).
MIN_GAIN = 0.02
# Least number of known cells for a fit (design choice: 20, because a fit has up to 8 unknowns).
MIN_CELLS = 20


class GaussNewton:
    """
    Gauss-Newton on one layer.

    Parameters
    ----------
    layer : Layer
        Cells of the view, and the map.
    state : RefinementState
        Initial state; it is updated in place.
    unknowns : Unknowns
        Parameters that are estimated.

    """

    def __init__(self, layer: Layer, state: RefinementState, unknowns: Unknowns) -> None:
        self._layer, self._state, self._unknowns = layer, state, unknowns
        self._stage = layer.stage
        self._agreeing: Floats | None = None
        self._edges: Floats | None = None
        self._prediction = MapPrediction(layer, state, unknowns)

    def run(self) -> LeastSquaresProblem:
        """Iterate until the steps are small; return the last problem."""
        stage = self._stage
        for count in range(stage.steps):
            problem = self._linearise(self._rounds(count))
            if np.count_nonzero(problem.all_weights) < MIN_CELLS:
                self._state.step = np.full(3, np.inf)
                return problem
            if not self._prediction.is_extrapolated:
                information = problem.information
            step = problem.step(information)
            length = self._move(step)
            if length < stage.factor and count >= stage.plain:
                break
            self._prediction.extrapolate((problem.predicted, problem.all_weights), step, length)
        return problem

    def _rounds(self, count: int) -> int:
        """Return the number of reweightings; 0 while misalignment looks like outliers."""
        if not self._unknowns.robust or count < self._stage.plain:
            return 0
        first = FIRST_ROUNDS if self._stage.plain and count == self._stage.plain else 0
        return EXPOSURE_ROUNDS[min(count, 1)] + first

    def estimate_shading(self, problem: LeastSquaresProblem) -> Floats:
        """Return shading factors (k,): those of the state plus a correction estimated here."""
        return self._state.shading + shading(
            self._layer.values, problem.predicted, problem.weights, self._stage.optical
        )

    def estimate_light(self) -> Light:
        """Estimate the light at the current state."""
        values = self._layer.values
        grey, under_light, known = self._prediction.light_inputs()
        gain, offset = exposure(values, under_light, known, least_gain=MIN_GAIN)
        values = (values - np.float32(offset)) * np.float32(1.0 / gain)
        return find_light(self._stage, values, grey, (known > 0.0).astype(np.float32))

    def _move(self, step: Floats) -> float:
        """Add a step to the state; return its length in units of DONE_XY and DONE_YAW."""
        x, y, yaw = (float(s) for s in np.clip(step[:3], -MAX_STEP, MAX_STEP))
        moving = self._unknowns.moving
        most = MAX_SUSPENSION[moving]
        self._state.step = np.array([x, y, yaw])
        self._state.pose = self._state.pose @ Pose2(x, y, yaw)
        self._state.camera_motion[moving] += np.clip(step[3 : 3 + len(moving)], -most, most)
        return max(abs(x) / DONE_XY, abs(y) / DONE_XY, abs(yaw) / DONE_YAW)

    def _linearise(self, rounds: int) -> LeastSquaresProblem:
        state, unknowns, stage = self._state, self._unknowns, self._stage
        predicted, known = self._prediction.current()
        used = self._without_disagreeing(predicted, known)
        gain, offset, residual = self._residual(predicted, used, state.exposure)
        if unknowns.robust:
            used = self._without_edges(used, residual, gain)
        scale_sq = mean_normalised_square(residual, used)
        trusted = curvature = used
        for _ in range(rounds):
            variance = max(scale_sq, stage.least_scale_sq)
            limit = outlier_scale(residual, used, variance)
            share, slope = robust_weights(residual, used, variance, limit)
            trusted, curvature = used * share, used * slope
            gain, offset, residual = self._residual(predicted, trusted, None)
            scale_sq = mean_normalised_square(residual, used)
        if unknowns.robust:
            state.exposure = gain, offset
        offsets = np.zeros(len(unknowns.prior))
        offsets[3 : 3 + len(unknowns.moving)] = state.camera_motion[unknowns.moving]
        instruments, slopes, exact = self._prediction.derivatives
        return LeastSquaresProblem(
            instruments=instruments, slopes=slopes, exact=exact, scales=unknowns.scales(gain),
            residual=residual, weights=trusted, curvature=curvature, all_weights=known,
            predicted=predicted, pattern=partial(self._prediction.pattern, predicted),
            gain=gain, offset=offset, scale_sq=scale_sq,
            pose_scale_sq=max(scale_sq, self._pose_scale_sq(residual, trusted)),
            prior=unknowns.prior, prior_offset=offsets,
        )

    def _pose_scale_sq(self, residual: Floats, weights: Floats) -> float:
        """Return the mean of r² W, weighted by the information of each cell on the pose."""
        _, (ahead, left, *_), _ = self._prediction.derivatives
        information = weights * (ahead**2 + left**2)
        summed = float(information.sum())
        return float(information @ (weights * residual**2)) / max(summed, 1e-20)

    def _without_edges(self, weights: Floats, residual: Floats, gain: float) -> Floats:
        """Return weights reduced by the noise at edges, which is estimated once."""
        steps = self._stage.pixel_steps
        if steps is None:
            return weights
        if self._edges is None:
            changes = steps.changes(*self._prediction.slopes) * np.float32(gain**2)
            self._edges = changes * np.float32(edge_share(residual, weights, changes))
        return weights / (np.float32(1.0) + weights * self._edges)

    def _without_disagreeing(self, predicted: Floats, weights: Floats) -> Floats:
        """Return weights without the blocks that disagree with the map, which are found once."""
        state = self._state
        if not self._unknowns.robust:
            return weights
        if self._agreeing is None:
            gain = None if state.exposure is None else state.exposure[0]
            self._agreeing, state.agreement = agreeing(
                self._layer.values, predicted, weights, self._stage.blocks, gain=gain
            )
            if state.exposure is None and self._unknowns.normalized:
                state.exposure = exposure(
                    self._layer.values, predicted, weights * self._agreeing, least_gain=MIN_GAIN
                )
        return weights * self._agreeing

    def _residual(
        self, predicted: Floats, weights: Floats, known: tuple[float, float] | None
    ) -> tuple[float, float, Floats]:
        """Return gain, offset (known, or by least squares) and residual."""
        values = self._layer.values
        if not self._unknowns.normalized:
            return 1.0, 0.0, values - predicted
        gain, offset = known or exposure(values, predicted, weights, least_gain=MIN_GAIN)
        return gain, offset, values - (np.float32(gain) * predicted + np.float32(offset))


def settled(step: Floats, covariance: Floats) -> bool:
    """Return whether the last step (3,) is small against the standard deviations of the result."""
    least = CONVERGED * np.array([DONE_XY, DONE_XY, DONE_YAW])
    sigmas = np.sqrt(np.diag(covariance))
    return bool(np.all(np.abs(step) < np.maximum(least, CONVERGED_SIGMAS * sigmas)))
