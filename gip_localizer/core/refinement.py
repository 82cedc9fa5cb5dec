# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a lattice winner to a continuous pose: Gauss-Newton under the same weighted norm.

The view is modelled as `v = a S û(pose, camera) + b + noise`, with the map û at the cells, the
camera's pixel blur S (`birdseye.Rectifier.pixel_blur`), gain a and offset b. With white pixel
noise the covariance of v is proportional to `S G⁻¹`, so the maximum-likelihood gradient is
`Jᵀ G (v - a S û - b)` and the Fisher information `Jᵀ G S J`: the paper's weights, exact also for
far cells that share pixels.

The first steps look at every other cell, without the blur; the last at all, with it.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import Rectifier, View
from gip_localizer.core.camera_sway import CameraSway
from gip_localizer.core.linearised import (
    block_sums,
    exposure,
    mean_normalised_square,
    Problem,
    trust,
)
from gip_localizer.core.pose import Pose2
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.parameters import CameraMotion

SPARSE_STRIDE = 2  # cells skipped by the first steps, per axis
SPARSE_STEPS = 8
FULL_STEPS = 8
PLAIN_STEPS = 3  # before outliers are told from misalignment
CONVERGED_XY = 3e-4  # m
CONVERGED_YAW = 5e-5  # rad
MAX_STEP = np.array([0.15, 0.15, 0.03])  # m, m, rad: no step may leave the basin
MAX_DRIFT = 1.0  # m from the start
OUTLIER_SCALE = 3.0  # residuals beyond this many standard deviations lose their weight
BLOCK_SIDES = (1.0, 0.5)  # m ahead, m left: residuals count as correlated within such blocks
LOCKING = 0.01  # of a map cell: what sampling between cell centres may shift a pose
MIN_GAIN = 0.02
MIN_CELLS = 20


@dataclass(frozen=True, eq=False)
class Fit:
    """
    A refined match.

    Attributes
    ----------
    pose : Pose2
        Base in map.
    covariance : (3, 3) float64
        Of x, y (m) and yaw (rad) in the axes of the pose (ahead, left), from the spread of the
        residuals' gradients over blocks of the road (sandwich estimate), so that correlated
        residuals count as what they are.
    fisher : (3, 3) float64
        Covariance by Fisher information alone (Cramér-Rao bound for white pixel noise and the
        weights as given).
    camera_motion : (3,) float64
        Estimated pitch, roll (rad) and height (m) relative to the calibration.
    gain, offset : float
        Of the view relative to the map, grey levels of [0, 1].
    residual : float
        Weighted mean square of the residuals of the cells that agree.
    inliers : float
        Share of the weight that agrees with the map, 0..1.
    correlation : float
        Weighted correlation of view and blurred map over all overlapping cells.
    overlap : float
        Share of the weight on known map cells.
    converged : bool
        The last step was small and the pose stayed near its start.
    chi_sq : float
        Mean of squared residuals over their expected variance (1 when the noise model holds).

    """

    pose: Pose2
    covariance: Floats
    fisher: Floats
    camera_motion: Floats
    gain: float
    offset: float
    residual: float
    inliers: float
    correlation: float
    overlap: float
    converged: bool
    chi_sq: float


@dataclass(eq=False)
class _State:
    """Pose, and pitch, roll (rad) and height (m) relative to the calibration."""

    pose: Pose2
    camera_motion: Floats


class _Cells:
    """The cells that one stage looks at."""

    def __init__(self, rectifier: Rectifier, stride: int) -> None:
        chosen = np.zeros_like(rectifier.valid)
        chosen[::stride, ::stride] = rectifier.valid[::stride, ::stride]
        if chosen.sum() < MIN_CELLS * 10:
            chosen, stride = rectifier.valid.copy(), 1
        self.index = np.flatnonzero(chosen)
        self.sway = CameraSway(rectifier.camera, rectifier.grid.points()[self.index])
        self.blur: sparse.csr_matrix | None = rectifier.pixel_blur if stride == 1 else None

    def blurred(self, columns: Floats) -> Floats:
        """Return columns behind the pixel blur."""
        return columns if self.blur is None else np.asarray(self.blur @ columns)


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
        self._sparse = _Cells(rectifier, SPARSE_STRIDE)
        self._full = _Cells(rectifier, 1)
        self._blocks = block_sums(self._full.sway.points, BLOCK_SIDES)

    def refine(self, view: View, weight: Floats, raster_map: RasterMap, start: Pose2) -> Fit:
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
            Base in map, within about two cells of the optimum.

        Returns
        -------
        Fit
            The refined pose; `converged` is False where it cannot be believed.

        """
        state = _State(start, np.zeros(3))
        self._descend(self._sparse, view, weight, raster_map, state,
                      steps=SPARSE_STEPS, plain=PLAIN_STEPS)
        problem, information, small = self._descend(
            self._full, view, weight, raster_map, state, steps=FULL_STEPS, plain=0
        )
        drift = math.hypot(state.pose.x - start.x, state.pose.y - start.y)
        locking = LOCKING * raster_map.resolution
        floor = np.diag([locking**2, locking**2, (0.2 * locking) ** 2])
        covariance = problem.sandwich(information, self._blocks) + floor
        known = float(problem.all_weights.sum())
        return Fit(
            pose=state.pose,
            covariance=covariance,
            fisher=problem.fisher(information),
            camera_motion=state.camera_motion,
            gain=problem.gain,
            offset=problem.offset,
            residual=problem.mean_square(),
            inliers=problem.inliers(),
            correlation=problem.correlation(),
            overlap=known / max(float(weight.sum(dtype=np.float64)), 1e-20),
            converged=small and drift < MAX_DRIFT and bool(np.isfinite(covariance).all()),
            chi_sq=problem.scale_sq,
        )

    def _descend(
        self, cells: _Cells, view: View, weight: Floats, raster_map: RasterMap, state: _State,
        *, steps: int, plain: int,
    ) -> tuple[Problem, Floats, bool]:
        """Step until the steps are small; moves the state in place."""
        values = view.patch.ravel()[cells.index]
        weights = weight.ravel()[cells.index]
        for count in range(steps):
            robust = self._robust and count >= plain
            problem = self._linearise(cells, values, weights, raster_map, state, robust=robust)
            if np.count_nonzero(problem.all_weights) < MIN_CELLS:
                return problem, np.eye(len(self._prior)), False
            information = problem.information()
            small = self._move(state, problem.step(information))
            if small and (robust or not self._robust):
                return problem, information, True
        return problem, information, False

    def _move(self, state: _State, step: Floats) -> bool:
        """Move the state; tell whether the step was small."""
        x, y, yaw = (float(s) for s in np.clip(step[:3], -MAX_STEP, MAX_STEP))
        state.pose = state.pose @ Pose2(x, y, yaw)
        state.camera_motion[self._moving] += step[3 : 3 + len(self._moving)]
        return max(abs(x), abs(y)) < CONVERGED_XY and abs(yaw) < CONVERGED_YAW

    def _linearise(
        self, cells: _Cells, values: Floats, weights: Floats, raster_map: RasterMap,
        state: _State, *, robust: bool,
    ) -> Problem:
        points = cells.sway.road_points(state.camera_motion)
        sampled, ahead, left, known = raster_map.sample_from(state.pose, points)
        used = weights * known
        predicted = cells.blurred(sampled)
        gain, offset, residual = self._residual(values, predicted, used)
        scale_sq = mean_normalised_square(residual, used)
        trusted = used
        if robust:
            trusted = used * trust(residual, used, scale_sq, OUTLIER_SCALE)
            gain, offset, residual = self._residual(values, predicted, trusted)
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
            jacobian, slopes, residual, trusted, used, predicted, gain, offset, scale_sq,
            self._prior, offsets,
        )

    def _residual(
        self, values: Floats, predicted: Floats, weights: Floats
    ) -> tuple[float, float, Floats]:
        gain, offset = 1.0, 0.0
        if self._normalized:
            gain, offset = exposure(values, predicted, weights, least_gain=MIN_GAIN)
        return gain, offset, values - np.float32(gain) * predicted - np.float32(offset)
