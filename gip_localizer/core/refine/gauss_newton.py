# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Gauss-Newton on the cells of one stage.

The map is sampled in the first step and after every long step. After a short step its values at
the new pose are extrapolated from the slopes at the last samples, which takes much less time.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.bilinear import Samples
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.edge_noise import edge_share
from gip_localizer.core.refine.exposure import exposure, shading
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.local_light import find_light, Light
from gip_localizer.core.refine.observation import Layer, RefinementState, Unknowns
from gip_localizer.core.refine.robust import (
    agreeing,
    mean_normalised_square,
    outlier_scale,
    robust_weights,
)

# Reweightings of gain and offset before a stage's first step, and before its other steps (chosen).
EXPOSURE_ROUNDS = (2, 1)
# Additional reweightings in the first stage, before which the exposure is unknown (chosen).
FIRST_ROUNDS = 2
# Step (m, rad) below which the last stage ends (chosen).
DONE_XY, DONE_YAW = 3e-4, 5e-5
# Largest last step of a converged fit, in units of DONE_XY and DONE_YAW (chosen).
CONVERGED = 8.0
# Largest last step of a converged fit, in standard deviations of the result (chosen).
CONVERGED_SIGMAS = 0.5
# Largest step, in units of DONE_XY and DONE_YAW, after which the map is extrapolated (chosen).
LINEAR = 10.0
# Largest step, in units of DONE_XY and DONE_YAW, after which the slopes are reused (chosen).
STALE = 20.0
# Largest step of the pose (m, m, rad), so that it stays in the basin of convergence (chosen).
MAX_STEP = np.array([0.15, 0.15, 0.03])
# Largest step of pitch, roll and height (rad, rad, m), so that the road stays in view (chosen).
MAX_SUSPENSION = np.array([0.03, 0.03, 0.1])
# Least gain of the view relative to the map (chosen).
MIN_GAIN = 0.02
# Least number of known cells for a fit (chosen).
MIN_CELLS = 20


Columns = tuple[Floats, Floats, Callable[[], Floats]]
"""Instruments and slopes (p, n) of a `LeastSquaresProblem`, and its exact instruments."""


class GaussNewton:
    """
    Steps on one layer.

    Parameters
    ----------
    layer : Layer
        The cells.
    state : RefinementState
        Where to start; moved in place.
    unknowns : Unknowns
        What is estimated.

    """

    def __init__(self, layer: Layer, state: RefinementState, unknowns: Unknowns) -> None:
        self._layer, self._state, self._unknowns = layer, state, unknowns
        self._stage = layer.stage
        self._agreeing: Floats | None = None
        self._columns: Columns | None = None
        self._sharp: tuple[Floats, Floats] | None = None
        self._seen: tuple[Floats, Floats] | None = None
        self._edges: Floats | None = None
        self._points: tuple[Floats, Floats]
        self._light = None if state.light is None else state.light.on(self._stage)
        self._shade = self._light.gain if self._light is not None else state.shade(self._stage)

    def run(self) -> LeastSquaresProblem:
        """Step until the steps are small; return the last problem."""
        stage = self._stage
        for count in range(stage.steps):
            problem = self._linearise(self._rounds(count))
            if np.count_nonzero(problem.all_weights) < MIN_CELLS:
                self._state.step = np.full(3, np.inf)
                return problem
            if self._seen is None:
                information = problem.information
            step = problem.step(information)
            length = self._move(step)
            if length < stage.factor and count >= stage.plain:
                break
            self._foresee(problem, step, length)
        return problem

    def _rounds(self, count: int) -> int:
        """Reweightings before a step; none while misalignment looks like outliers."""
        if not self._unknowns.robust or count < self._stage.plain:
            return 0
        first = FIRST_ROUNDS if self._stage.plain and count == self._stage.plain else 0
        return EXPOSURE_ROUNDS[min(count, 1)] + first

    def _foresee(self, problem: LeastSquaresProblem, step: Floats, length: float) -> None:
        """Keep samples and slopes of the map for the next step if this step was short."""
        self._seen = None
        if length > STALE:
            self._columns = None
        elif length <= LINEAR:
            free = 3 + len(self._unknowns.moving)
            change = step[:free].astype(np.float32) @ problem.slopes[:free]
            predicted = problem.predicted + change
            self._seen = predicted, problem.all_weights

    def shaded(self, problem: LeastSquaresProblem) -> Floats:
        """Shading factors (k,): those of the state plus the correction estimated here."""
        return self._state.shading + shading(
            self._layer.values, problem.predicted, problem.weights, self._stage.optical
        )

    def lit(self) -> Light:
        """Estimate the light at the current state."""
        values, samples = self._layer.values, self._sampled()
        known = self._known(samples)
        gain, offset = exposure(values, self._under_light(samples), known, least_gain=MIN_GAIN)
        values = (values - np.float32(offset)) * np.float32(1.0 / gain)
        return find_light(self._stage, values, samples.values, (known > 0.0).astype(np.float32))

    def _pattern(self, predicted: Floats) -> Floats:
        """Part of the prediction (n,) that the light model does not explain."""
        if self._light is None:
            return predicted
        return predicted - (self._light.veil + self._light.gain * self._light.broad)

    def _move(self, step: Floats) -> float:
        """Move the state; return the length of the step (below 1: done)."""
        x, y, yaw = (float(s) for s in np.clip(step[:3], -MAX_STEP, MAX_STEP))
        moving = self._unknowns.moving
        most = MAX_SUSPENSION[moving]
        self._state.step = np.array([x, y, yaw])
        self._state.pose = self._state.pose @ Pose2(x, y, yaw)
        self._state.camera_motion[moving] += np.clip(step[3 : 3 + len(moving)], -most, most)
        return max(abs(x) / DONE_XY, abs(y) / DONE_XY, abs(yaw) / DONE_YAW)

    def _linearise(self, rounds: int) -> LeastSquaresProblem:
        state, unknowns, stage = self._state, self._unknowns, self._stage
        predicted, known = self._seen or self._look()
        used = self._agreed(predicted, known)
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
        assert self._columns is not None
        offsets = np.zeros(len(unknowns.prior))
        offsets[3 : 3 + len(unknowns.moving)] = state.camera_motion[unknowns.moving]
        return LeastSquaresProblem(
            *self._columns, unknowns.scales(gain), residual, trusted, curvature, known, predicted,
            partial(self._pattern, predicted), gain, offset,
            scale_sq, max(scale_sq, self._telling_scale_sq(residual, trusted)),
            unknowns.prior, offsets,
        )

    def _telling_scale_sq(self, residual: Floats, weights: Floats) -> float:
        """Mean of r² W over the cells, weighted by the information of each cell on the pose."""
        assert self._columns is not None
        _, (ahead, left, *_), _ = self._columns
        information = weights * (ahead**2 + left**2)
        summed = float(information.sum())
        return float(information @ (weights * residual**2)) / max(summed, 1e-20)

    def _without_edges(self, weights: Floats, residual: Floats, gain: float) -> Floats:
        """Weights reduced by the noise at edges, which is estimated once."""
        steps = self._stage.pixel_steps
        if steps is None:
            return weights
        if self._edges is None:
            assert self._sharp is not None
            changes = steps.changes(*self._sharp) * np.float32(gain**2)
            self._edges = changes * np.float32(edge_share(residual, weights, changes))
        return weights / (np.float32(1.0) + weights * self._edges)

    def _look(self) -> tuple[Floats, Floats]:
        """Blurred map and weights of known cells, (n,); outdated slopes are computed again."""
        samples = self._sampled()
        sampled = self._under_light(samples)
        predicted = self._stage.blurred(sampled)
        if self._columns is None:
            self._columns = self._slopes(samples, sampled, predicted)
        return predicted, self._known(samples)

    def _sampled(self) -> Samples:
        """Sample the map at the cells."""
        self._points = self._stage.suspension.road_points(self._state.camera_motion)
        return self._layer.raster_map.sample_from(self._state.pose, *self._points)

    def _under_light(self, samples: Samples) -> Floats:
        if self._shade is None:
            return samples.values
        lit = samples.values * self._shade
        return lit if self._light is None else lit + self._light.veil

    def _known(self, samples: Samples) -> Floats:
        """Weights (n,); 0 for cells outside the known map."""
        known = self._layer.weights
        if samples.valid is not None:
            known = known * samples.valid
        return self._less_noise(known, samples)

    def _less_noise(self, weights: Floats, samples: Samples) -> Floats:
        """Weights (n,) reduced by the noise that the map specifies: G = 1/(1/G + a² σ²)."""
        noise = self._layer.raster_map.noise
        if noise is None:
            return weights
        gain = self._state.exposure[0] if self._state.exposure else 1.0
        variance = (np.float32(gain) * samples.nearest_of(noise)) ** 2
        return np.asarray(weights / (np.float32(1.0) + weights * variance))

    def _slopes(self, samples: Samples, sampled: Floats, predicted: Floats) -> Columns:
        """Instruments and slopes; the pixel blur does not change the lever arms."""
        points = self._points
        ahead, left = self._under_shade(samples.slopes())
        self._sharp = ahead, left
        exact = partial(self._by_unknown, ahead, left, sampled, points)
        instruments = self._by_unknown(*self._calmed(samples), sampled, points)
        if self._stage.blur is None and self._layer.calm_slopes is None:
            return instruments, instruments, exact
        ahead, left = self._stage.blurred(ahead), self._stage.blurred(left)
        return instruments, self._by_unknown(ahead, left, predicted, points), exact

    def _calmed(self, samples: Samples) -> tuple[Floats, Floats]:
        """Slopes (n,) of the map, blurred as far as a cell errs with the map."""
        assert self._sharp is not None
        ahead, left = self._sharp
        calm = self._layer.calm_slopes
        if calm is None:
            return ahead, left
        calm_ahead, calm_left = self._under_shade(samples.slopes_of(*calm))
        share = self._layer.pixel_share
        return calm_ahead + share * (ahead - calm_ahead), calm_left + share * (left - calm_left)

    def _under_shade(self, slopes: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
        if self._shade is None:
            return slopes
        return slopes[0] * self._shade, slopes[1] * self._shade

    def _by_unknown(
        self, ahead: Floats, left: Floats, grey: Floats, points: tuple[Floats, Floats]
    ) -> Floats:
        """Slopes (p, n) for each unknown, of a map with slopes along x and y (n,)."""
        x, y = points
        rows = np.empty((len(self._unknowns.prior), len(grey)), np.float32)
        rows[0], rows[1] = ahead, left
        np.multiply(left, x, out=rows[2])
        rows[2] -= ahead * y
        for row, moving in zip(rows[3:], self._unknowns.moving, strict=False):
            along_x, along_y = self._stage.suspension.tangents[moving]
            np.multiply(ahead, along_x, out=row)
            row += left * along_y
        if self._unknowns.normalized:
            rows[-2], rows[-1] = grey, 1.0
        return rows

    def _agreed(self, predicted: Floats, weights: Floats) -> Floats:
        """Weights without the blocks that disagree with the map, which are found once."""
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
        """Gain, offset (known, or by least squares) and residual."""
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
