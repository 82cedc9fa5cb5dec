# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a lattice winner to a continuous pose: Gauss-Newton under the same weighted norm.

The view is modelled as `v = a S û(pose, camera) + b + noise`, with the map û at the cells, the
camera's pixel blur S (`birdseye.Rectifier.pixel_blur`), gain a and offset b. With white pixel
noise the covariance of v is proportional to `S G⁻¹`, so the maximum-likelihood gradient is
`Jᵀ G (v - a S û - b)` and the Fisher information `Jᵀ G S J`: the paper's weights, exact also for
far cells that share pixels.

The first steps look at joined cells and a smoothed map, which widens the basin; the last at all
cells, with the blur.

"""

from __future__ import annotations

from dataclasses import dataclass, field
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import Rectifier, View
from gip_localizer.core.fit import Fit
from gip_localizer.core.levels import coarsened
from gip_localizer.core.linearised import (
    agreeing,
    block_sums,
    exposure,
    mean_normalised_square,
    Problem,
    shading,
    trust,
)
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.core.stages import make_stages, OPTICAL_TERMS, Stage
from gip_localizer.parameters import CameraMotion

EXPOSURE_ROUNDS = (4, 2)  # reweightings of gain and offset before a stage's first step, others
DONE_XY, DONE_YAW = 3e-4, 5e-5  # m, rad: smaller steps end a stage
CONVERGED = 8.0  # last step, in these, below which the outcome is believed, ...
CONVERGED_SIGMAS = 0.5  # ... or in standard deviations of the outcome
MAX_STEP = np.array([0.15, 0.15, 0.03])  # m, m, rad: no step may leave the basin
MAX_DRIFT = 1.0  # m from the start
OUTLIER_SCALE = 3.0  # residuals beyond this many standard deviations lose their weight
BLOCK_SIDES = (1.0, 0.5)  # m ahead, m left: residuals count as correlated within such blocks
LEAST_BLOCKS = 10  # along each axis
LOCKING = 0.0037  # of a map cell: what sampling between cell centres may still shift a pose
STAGE_SHARE = 0.05  # of the squared change since the coarser stage that counts as variance
MIN_GAIN = 0.02
PITCH_BASIN = 0.005  # rad: pitch from which the first stage still finds its way
MIN_CELLS = 20


def _pitches(sigma: float) -> list[float]:
    """Pitches to start from, rad: the calibrated one first, then outwards to two sigmas."""
    count = int(2.0 * sigma / PITCH_BASIN)
    spacing = 2.0 * sigma / max(count, 1)
    return [0.0, *(sign * k * spacing for k in range(1, count + 1) for sign in (1, -1))]


@dataclass(eq=False)
class _State:
    """Pose; pitch, roll (rad), height (m) relative to the calibration; what the view is like."""

    pose: Pose2
    camera_motion: Floats
    exposure: tuple[float, float] | None = None
    agreeing: Floats | None = None
    agreement: float = 1.0
    step: Floats = field(default_factory=lambda: np.zeros(3))
    shading: Floats = field(default_factory=lambda: np.zeros(OPTICAL_TERMS))


def _is_covariance(matrix: Floats) -> bool:
    """Tell whether a matrix is finite and positive definite."""
    return bool(np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix).min() > 0.0)


def _is_small(step: Floats, covariance: Floats) -> bool:
    """Tell whether a last step (3,) is little against the outcome's standard deviations."""
    least = CONVERGED * np.array([DONE_XY, DONE_XY, DONE_YAW])
    return bool(np.all(
        np.abs(step) < np.maximum(least, CONVERGED_SIGMAS * np.sqrt(np.diag(covariance)))
    ))


class Refiner:
    """
    Gauss-Newton for one calibration.

    Parameters
    ----------
    rectifier : Rectifier
        Gives the cells and the pixel blur.
    camera_motion : CameraMotion
        Standard deviations of the camera's motion; zeros fix it.
    normalized : bool
        True: gain and offset are unknown.
    robust : bool
        True: cells that disagree with the map lose their weight.

    """

    def __init__(
        self, rectifier: Rectifier, camera_motion: CameraMotion, *, normalized: bool, robust: bool
    ) -> None:
        self.camera = rectifier.camera
        self.pitches = _pitches(camera_motion.sigma_pitch)
        self._normalized = normalized
        self._robust = robust
        sigmas = np.array(
            [camera_motion.sigma_pitch, camera_motion.sigma_roll, camera_motion.sigma_height]
        )
        self._moving = np.flatnonzero(sigmas > 0.0)
        exposed = 2 if normalized else 0
        self._prior = np.concatenate(
            [np.zeros(3), 1.0 / sigmas[self._moving] ** 2, np.zeros(exposed)]
        )
        self._stages = make_stages(rectifier)
        grid = rectifier.grid
        extent = (grid.rows * grid.resolution, grid.cols * grid.resolution)
        sides = [min(s, e / LEAST_BLOCKS) for s, e in zip(BLOCK_SIDES, extent, strict=True)]
        self._blocks = block_sums(self._stages[-1].sway.points, (sides[0], sides[1]))

    def refine(
        self, view: View, weight: Floats, raster_map: RasterMap, start: Pose2, *,
        pitch: float = 0.0,
    ) -> Fit:
        """
        Improve a pose.

        Parameters
        ----------
        view : View
            Bird's-eye view of the rectifier.
        weight : (rows, cols) float32
            The Gramian's diagonal.
        raster_map : RasterMap
            The map, or a crop that covers the view about the start.
        start : Pose2
            Base in map, within about 0.2 m of the optimum.
        pitch : float
            Pitch relative to the calibration to start from, rad.

        Returns
        -------
        Fit
            The refined pose; `converged` is False where it cannot be believed.

        """
        state = _State(start, np.array([pitch, 0.0, 0.0]))
        for stage in self._stages:
            coarser = state.pose
            state.agreeing = None
            joined, weights = coarsened(view, weight, stage.factor)
            seen = joined.patch.ravel()[stage.index]
            problem = self._descend(
                stage, seen, weights.ravel()[stage.index],
                raster_map.smoothed(stage.resolution), state,
            )
            if self._normalized and stage.factor > 1:
                state.shading += shading(seen, problem.predicted, problem.weights, stage.optical)
        drift = math.hypot(state.pose.x - start.x, state.pose.y - start.y)
        locking = LOCKING * raster_map.resolution
        floor = np.diag([locking**2, locking**2, (0.2 * locking) ** 2])
        change = difference(coarser.inverse() @ state.pose, Pose2(0.0, 0.0, 0.0))
        spread = problem.sandwich(self._blocks)
        covariance = spread + floor
        covariance += STAGE_SHARE * np.outer(change, change)
        known = float(problem.all_weights.sum())
        return Fit(
            pose=state.pose,
            covariance=covariance,
            fisher=problem.fisher(),
            camera_motion=state.camera_motion,
            gain=problem.gain,
            offset=problem.offset,
            residual=problem.mean_square(),
            inliers=problem.inliers(),
            correlation=problem.correlation(),
            agreement=state.agreement,
            overlap=known / max(float(weight.sum(dtype=np.float64)), 1e-20),
            converged=drift < MAX_DRIFT and _is_covariance(covariance)
            and _is_small(state.step, covariance),
            chi_sq=problem.scale_sq,
            overdispersion=problem.overdispersion(spread),
        )

    def _descend(
        self, stage: Stage, values: Floats, weights: Floats, raster_map: RasterMap, state: _State
    ) -> Problem:
        """Step until the steps are small; moves the state in place."""
        for count in range(stage.steps):
            rounds = EXPOSURE_ROUNDS[min(count, 1)]
            if not self._robust or count < stage.plain:
                rounds = 0
            problem = self._linearise(stage, values, weights, raster_map, state, rounds=rounds)
            if np.count_nonzero(problem.all_weights) < MIN_CELLS:
                state.step = np.full(3, np.inf)
                return problem
            step = self._move(state, problem.step(problem.information()))
            if step < 1.0 and count >= stage.plain:
                break
        return problem

    def _move(self, state: _State, step: Floats) -> float:
        """Move the state; return the length of the step (below 1: done)."""
        x, y, yaw = (float(s) for s in np.clip(step[:3], -MAX_STEP, MAX_STEP))
        state.pose = state.pose @ Pose2(x, y, yaw)
        state.step = np.array([x, y, yaw])
        state.camera_motion[self._moving] += step[3 : 3 + len(self._moving)]
        return max(abs(x) / DONE_XY, abs(y) / DONE_XY, abs(yaw) / DONE_YAW)

    def _linearise(
        self, cells: Stage, values: Floats, weights: Floats, raster_map: RasterMap,
        state: _State, *, rounds: int,
    ) -> Problem:
        points = cells.sway.road_points(state.camera_motion)
        sampled, ahead, left, known = raster_map.sample_from(state.pose, points)
        if state.shading.any():
            shade = np.float32(1.0) + cells.optical @ state.shading.astype(np.float32)
            sampled, ahead, left = sampled * shade, ahead * shade, left * shade
        used = everywhere = weights * known
        predicted = cells.blurred(sampled)
        if self._robust:
            used = self._agreeing(cells, values, predicted, used, state)
        gain, offset, residual = self._residual(values, predicted, used, state.exposure)
        scale_sq = mean_normalised_square(residual, used)
        trusted = curvature = used
        for _ in range(rounds):
            share, slope = trust(
                residual, used, max(scale_sq, cells.least_scale_sq), OUTLIER_SCALE
            )
            trusted, curvature = used * share, used * slope
            gain, offset, residual = self._residual(values, predicted, trusted, None)
            scale_sq = mean_normalised_square(residual, used)
        if self._robust:
            state.exposure = gain, offset
        columns = [ahead, left, left * points[:, 0] - ahead * points[:, 1]]
        columns += [
            ahead * cells.sway.tangents[k][:, 0] + left * cells.sway.tangents[k][:, 1]
            for k in self._moving
        ]
        jacobian = np.stack(columns, axis=1) * np.float32(gain)
        slopes = cells.blurred(jacobian)
        if self._normalized:
            ones = np.ones_like(sampled)
            jacobian = np.column_stack([jacobian, sampled, ones])
            slopes = np.column_stack([slopes, predicted, ones])
        offsets = np.zeros(len(self._prior))
        offsets[3 : 3 + len(self._moving)] = state.camera_motion[self._moving]
        return Problem(
            jacobian, slopes, residual, trusted, curvature, everywhere, predicted, gain, offset,
            scale_sq, self._prior, offsets,
        )

    def _agreeing(
        self, cells: Stage, values: Floats, predicted: Floats, weights: Floats, state: _State
    ) -> Floats:
        """Weights without the blocks that do not show the map; found once per stage."""
        if state.agreeing is None:
            gain = None if state.exposure is None else state.exposure[0]
            state.agreeing, state.agreement = agreeing(
                values, predicted, weights, cells.blocks, gain=gain
            )
            if state.exposure is None and self._normalized:
                plain = weights * state.agreeing
                state.exposure = exposure(values, predicted, plain, least_gain=MIN_GAIN)
        return weights * state.agreeing

    def _residual(
        self, values: Floats, predicted: Floats, weights: Floats,
        known: tuple[float, float] | None,
    ) -> tuple[float, float, Floats]:
        """Gain, offset (known, or by least squares) and residual."""
        gain, offset = 1.0, 0.0
        if self._normalized:
            gain, offset = known or exposure(values, predicted, weights, least_gain=MIN_GAIN)
        return gain, offset, values - np.float32(gain) * predicted - np.float32(offset)
