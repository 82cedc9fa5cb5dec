# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a lattice winner to a continuous pose: Gauss-Newton under the same weighted norm.

The view is modelled as `v = a S û(pose, camera) + b + noise`, with the map û at the cells, the
camera's pixel blur S (`birdseye.Rectifier.pixel_blur`), gain a and offset b. With white pixel
noise the covariance of v is proportional to `S G⁻¹`, so the maximum-likelihood gradient is
`Jᵀ G (v - a S û - b)` and the Fisher information `Jᵀ G S J`: the paper's weights, exact also for
far cells that share pixels.

The state is (x, y, yaw) in the axes of the start pose, then the camera's (pitch, roll, height)
as far as they may move, then gain and offset where they are unknown.

"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye import Rectifier, View
from gip_localizer.core.pose import Pose2
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.parameters import CameraMotion

MAX_ITERATIONS = 12
PLAIN_ITERATIONS = 3  # before outliers are told from misalignment
CONVERGED_XY = 2e-4  # m
CONVERGED_YAW = 2e-5  # rad
MAX_STEP = np.array([0.15, 0.15, 0.03])  # m, m, rad: no iteration may leave the basin
OUTLIER_SCALE = 3.0  # residuals beyond this many standard deviations lose their weight
BLOCK_M = 0.5  # m: residuals are taken as correlated within blocks of this side
MIN_GAIN = 0.02


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
        Weighted mean of squared residuals over their expected variance (1 when the noise model
        holds).

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


class Refiner:
    """
    Gauss-Newton for one calibration.

    Parameters
    ----------
    rectifier : Rectifier
        Gives the cells, their pixel rays and the pixel blur.
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
        self._camera = rectifier.camera
        self._valid = rectifier.valid.ravel()
        self._points = rectifier.grid.points()[self._valid]
        self._blur = rectifier.pixel_blur
        self._normalized = normalized
        self._robust = robust
        sigmas = np.array(
            [camera_motion.sigma_pitch, camera_motion.sigma_roll, camera_motion.sigma_height]
        )
        self._moving = np.flatnonzero(sigmas > 0.0)
        self._prior = 1.0 / sigmas[self._moving] ** 2
        offsets = self._points - rectifier.camera.extrinsics.position()[:2]
        heights = np.full(len(offsets), -rectifier.camera.extrinsics.z)
        self._directions = np.column_stack([offsets, heights])
        self._tangents = self._camera_tangents()
        self._blocks = _block_sums(self._points)

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
        values = view.patch.ravel()[self._valid].astype(np.float64)
        weights = weight.ravel()[self._valid].astype(np.float64)
        state = _State(start, np.zeros(3))
        problem, converged = self._solve(values, weights, raster_map, state)
        near = np.hypot(problem.state.pose.x - start.x, problem.state.pose.y - start.y)
        return self._fit(problem, weights, converged=converged and bool(near < 1.0))

    def _solve(
        self, values: Floats, weights: Floats, raster_map: RasterMap, state: _State
    ) -> tuple[_Problem, bool]:
        converged = False
        for iteration in range(MAX_ITERATIONS):
            robust = self._robust and iteration >= PLAIN_ITERATIONS
            problem = self._linearise(values, weights, raster_map, state, robust=robust)
            if problem.known.sum() < 20 or converged:
                break
            step = problem.step()
            step[:3] = np.clip(step[:3], -MAX_STEP, MAX_STEP)
            state = self._moved(state, step)
            small = max(np.abs(step[:2]).max() / CONVERGED_XY, abs(step[2]) / CONVERGED_YAW) < 1
            converged = small and (robust or not self._robust)
        return problem, converged

    def _moved(self, state: _State, step: Floats) -> _State:
        motion = state.camera_motion.copy()
        motion[self._moving] += step[3 : 3 + len(self._moving)]
        pose = state.pose @ Pose2(float(step[0]), float(step[1]), float(step[2]))
        return replace(state, pose=pose, camera_motion=motion)

    def _linearise(
        self, values: Floats, weights: Floats, raster_map: RasterMap, state: _State, *,
        robust: bool,
    ) -> _Problem:
        points = self._road_points(state.camera_motion)
        world = state.pose.transform(points)
        sampled, slope, known = raster_map.sample_with_gradient(world)
        ahead_left = slope.astype(np.float64) @ state.pose.rotation()
        used = np.where(known, weights, 0.0)
        predicted = self._blur @ sampled.astype(np.float64)
        gain, offset = self._exposure(values, predicted, used)
        residual = values - gain * predicted - offset
        scale_sq = _scale_sq(residual, used)
        trusted = _trust(residual, used, scale_sq) if robust else np.ones(len(residual))
        if robust:
            gain, offset = self._exposure(values, predicted, used * trusted)
            residual = values - gain * predicted - offset
        columns = [ahead_left[:, 0], ahead_left[:, 1],
                   ahead_left[:, 1] * points[:, 0] - ahead_left[:, 0] * points[:, 1]]
        columns += [
            ahead_left[:, 0] * self._tangents[k][:, 0] + ahead_left[:, 1] * self._tangents[k][:, 1]
            for k in self._moving
        ]
        jacobian = gain * np.stack(columns, axis=1)
        return _Problem(
            state, jacobian, predicted, residual, used * trusted, used, known, gain, offset,
            self._blur, self._prior, state.camera_motion[self._moving], scale_sq,
            self._normalized,
        )

    def _exposure(self, values: Floats, predicted: Floats, weights: Floats) -> tuple[float, float]:
        total = weights.sum()
        if not self._normalized or total <= 0.0:
            return 1.0, 0.0
        mean_v, mean_m = weights @ values / total, weights @ predicted / total
        spread = weights @ (predicted - mean_m) ** 2
        gain = weights @ ((values - mean_v) * (predicted - mean_m)) / max(spread, 1e-12)
        gain = max(float(gain), MIN_GAIN)
        return gain, float(mean_v - gain * mean_m)

    def _road_points(self, camera_motion: Floats) -> Floats:
        """Where the cells' rays meet the road when the camera has moved, (n, 2) in base."""
        if not camera_motion.any():
            return self._points
        pitch, roll, height = camera_motion
        pose = self._camera.extrinsics
        moved = replace(pose, pitch=pose.pitch + pitch, roll=pose.roll + roll)
        turn = moved.rotation() @ pose.rotation().T
        rays = self._directions @ turn.T
        rays[:, 2] = np.minimum(rays[:, 2], -1e-3)
        scale = -(pose.z + height) / rays[:, 2]
        points: Floats = pose.position()[:2] + rays[:, :2] * scale[:, None]
        return points

    def _camera_tangents(self) -> list[Floats]:
        """Motion of the road points per radian of pitch, of roll, and per metre of height."""
        small = 1e-5
        return [
            (self._road_points(small * unit) - self._road_points(-small * unit)) / (2 * small)
            for unit in np.eye(3)
        ]

    def _fit(self, problem: _Problem, weights: Floats, *, converged: bool) -> Fit:
        covariance, fisher = problem.covariances(self._blocks)
        total = max(weights.sum(), 1e-20)
        return Fit(
            pose=problem.state.pose,
            covariance=covariance,
            fisher=fisher,
            camera_motion=problem.state.camera_motion,
            gain=problem.gain,
            offset=problem.offset,
            residual=problem.mean_square(),
            inliers=float(problem.weights.sum() / max(problem.all_weights.sum(), 1e-20)),
            correlation=problem.correlation(),
            overlap=float(problem.all_weights.sum() / total),
            converged=converged and bool(np.isfinite(covariance).all()),
            chi_sq=problem.scale_sq,
        )


@dataclass(frozen=True)
class _State:
    pose: Pose2
    camera_motion: Floats


@dataclass(frozen=True, eq=False)
class _Problem:
    """The linearised least-squares problem at one state."""

    state: _State
    jacobian: Floats  # (n, p): unblurred map slopes times gain
    predicted: Floats
    residual: Floats
    weights: Floats
    all_weights: Floats
    known: Bools
    gain: float
    offset: float
    blur: sparse.csr_matrix
    prior: Floats
    camera_motion: Floats
    scale_sq: float
    normalized: bool

    def step(self) -> Floats:
        """Gauss-Newton step of the geometric state."""
        instruments, information, _ = self._normal_equations()
        gradient = instruments.T @ (self.weights * self.residual)
        gradient[3 : 3 + len(self.prior)] -= self.scale_sq * self.prior * self.camera_motion
        step: Floats = np.linalg.solve(information, gradient)
        return step

    def _normal_equations(self) -> tuple[Floats, Floats, Floats]:
        """Instruments (n, p), information (p, p) and blurred Jacobian (n, p)."""
        instruments, blurred = self.jacobian, self.blur @ self.jacobian
        if self.normalized:
            basis = np.column_stack([self.predicted, np.ones(len(self.predicted))])
            instruments = _without(instruments, basis, self.weights)
            blurred = _without(blurred, basis, self.weights)
        information = instruments.T @ (self.weights[:, None] * blurred)
        information = 0.5 * (information + information.T)
        prior = np.zeros(len(information))
        prior[3 : 3 + len(self.prior)] = self.scale_sq * self.prior
        information += np.diag(prior + 1e-9 * np.trace(information) + 1e-12)
        return instruments, information, blurred

    def covariances(self, blocks: sparse.csr_matrix) -> tuple[Floats, Floats]:
        """Sandwich and Fisher covariance of (x, y, yaw) in the pose's axes."""
        instruments, information, _ = self._normal_equations()
        inverse = np.linalg.inv(information)
        scores = blocks @ (instruments * (self.weights * self.residual)[:, None])
        count = max(int(np.count_nonzero(np.abs(scores).sum(axis=1))), 1)
        meat = scores.T @ scores * (count / max(count - len(information), 1))
        index = np.arange(3, 3 + len(self.prior))
        meat[index, index] += self.scale_sq**2 * self.prior
        sandwich = inverse @ meat @ inverse
        fisher = self.scale_sq * inverse
        return sandwich[:3, :3], fisher[:3, :3]

    def mean_square(self) -> float:
        """Weighted mean square residual of the cells that agree."""
        return float(self.weights @ self.residual**2 / max(self.weights.sum(), 1e-20))

    def correlation(self) -> float:
        """Weighted correlation of view and prediction over all known cells."""
        w = self.all_weights
        if w.sum() <= 0.0:
            return 0.0
        v = self.residual + self.gain * self.predicted + self.offset
        dv = v - w @ v / w.sum()
        dm = self.predicted - w @ self.predicted / w.sum()
        spread = np.sqrt((w @ dv**2) * (w @ dm**2))
        return float(w @ (dv * dm) / spread) if spread > 1e-12 else 0.0


def _without(columns: Floats, basis: Floats, weights: Floats) -> Floats:
    """Project the basis out of the columns under the weights."""
    weighted = basis * weights[:, None]
    normal = basis.T @ weighted + 1e-12 * np.eye(basis.shape[1])
    projected: Floats = columns - basis @ np.linalg.solve(normal, weighted.T @ columns)
    return projected


def _scale_sq(residual: Floats, weights: Floats) -> float:
    """Robust mean of the squared normalised residuals (1 when the weights are 1/variance)."""
    normalised = np.abs(residual) * np.sqrt(weights)
    chosen = normalised[weights > 0.0]
    if chosen.size == 0:
        return 1.0
    return max(float(np.median(chosen) / 0.6745) ** 2, 1e-6)


def _trust(residual: Floats, weights: Floats, scale_sq: float) -> Floats:
    """Geman-McClure weights: near 1 for residuals within the scale, near 0 far outside."""
    ratio = residual**2 * weights / (OUTLIER_SCALE**2 * scale_sq)
    trust: Floats = 1.0 / (1.0 + ratio) ** 2
    return trust


def _block_sums(points: Floats) -> sparse.csr_matrix:
    """Matrix (blocks, n) that adds up the cells of each block of road."""
    index = np.floor((points - points.min(axis=0)) / BLOCK_M).astype(int)
    _, block = np.unique(index[:, 0] * 100_000 + index[:, 1], return_inverse=True)
    block = np.asarray(block).ravel()
    n = len(points)
    return sparse.csr_matrix(
        (np.ones(n), (block, np.arange(n))), shape=(int(block.max()) + 1, n)
    )
