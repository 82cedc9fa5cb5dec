# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a lattice winner to a continuous pose: Gauss-Newton under the same weighted norm.

The view is modelled as `v = a S û(pose, camera) + b + noise`, with the map û at the cells, the
camera's pixel blur S (`birdseye.Rectifier.pixel_blur`), gain a and offset b. With white pixel
noise the covariance of v is proportional to `S G⁻¹`, so the maximum-likelihood gradient is
`Jᵀ G (v - a S û - b)` and the Fisher information `Jᵀ G S J`: the paper's weights, exact also for
far cells that share pixels.

The first steps look at averaged cells and a smoothed map, which widens the basin; the last at all
cells, with the blur.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import math

import numpy as np

from gip_localizer.core.arrays import Floats, Ints
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.map.crop import Crop
from gip_localizer.core.match.downsampling import downsampled_view
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.refine.gauss_newton import GaussNewton, settled
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.observation import FrameErrors, Layer, RefinementState, Unknowns
from gip_localizer.core.refine.smooth_errors import BlockSums, SharedErrors, SmoothErrors
from gip_localizer.core.refine.stages import make_stages
from gip_localizer.parameters import CameraMotion

# Largest distance (m) of a converged pose from its start (chosen).
MAX_DRIFT = 1.0
# Share of the squared change since the coarser stage that counts as variance (chosen).
STAGE_SHARE = 0.001
# Largest change (map cells) that counts so; a larger one is the convergence itself (chosen).
MOST_CHANGE = 0.2
# Share of the weight that agrees where view and map differ by noise alone (chosen).
EXPECTED_INLIERS = 0.95
# Least share of the weight that is assumed to agree (chosen).
LEAST_INLIERS = 0.1
# Estimates of the light before the first step; gain and offset depend on it (chosen).
LIGHT_ROUNDS = 3
# Pitch error (rad) from which the first stage still converges (chosen).
PITCH_BASIN = 0.005


def _pitches(sigma: float) -> list[float]:
    """Pitches to start from, rad: the calibrated one first, then outwards to two sigmas."""
    count = int(2.0 * sigma / PITCH_BASIN)
    spacing = 2.0 * sigma / max(count, 1)
    return [0.0, *(sign * k * spacing for k in range(1, count + 1) for sign in (1, -1))]


def _is_covariance(matrix: Floats) -> bool:
    """Return whether a matrix is finite and positive definite."""
    return bool(np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix).min() > 0.0)


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
    sigma_yaw : float
        Standard deviation of the camera's calibrated yaw, rad.

    Attributes
    ----------
    mount : (3, 3) float64
        Covariance of x, y (m) and yaw (rad) from that yaw, in the axes of the pose.

    """

    def __init__(
        self, rectifier: Rectifier, camera_motion: CameraMotion, *, normalized: bool,
        robust: bool, sigma_yaw: float = 0.0,
    ) -> None:
        self.camera = rectifier.camera
        self.pitches = _pitches(camera_motion.sigma_pitch)
        self._unknowns = _unknowns(camera_motion, normalized=normalized, robust=robust)
        self._stages = make_stages(rectifier)
        self._smooth_errors = SmoothErrors(
            self._stages[-1].block_centres, rectifier.camera.extrinsics.position()
        )
        self.mount = _of_mount_yaw(rectifier.camera.extrinsics.position(), sigma_yaw)

    def layers(
        self, view: View, weight: Floats, crop: Crop, errors: FrameErrors | None = None,
        stages: slice = slice(None),
    ) -> list[Layer]:
        """
        Prepare a frame for the stages, once for all starts.

        Parameters
        ----------
        view : View
            Bird's-eye view of the rectifier.
        weight : (rows, cols) float32
            The Gramian's diagonal.
        crop : Crop
            Of the map; covers the view about all starts.
        errors : FrameErrors or None
            What is known of them; None: no noise of the map, no frame before.
        stages : slice
            Which; all of them, coarse to fine, where it is not given.

        """
        errors = errors or FrameErrors()
        layers = []
        for stage in self._stages[stages]:
            larger, weights = downsampled_view(view, weight, stage.factor)
            weighed = weights.ravel()[stage.index]
            calm = stage.factor == 1 and errors.map_noise > 0.0
            layers.append(Layer(
                stage, larger.patch.ravel()[stage.index], weighed,
                crop.for_cells(stage.resolution), crop.locking(stage.resolution),
                crop.calm_slopes(stage.resolution) if calm else None,
                np.maximum(np.float32(1.0) - weighed * np.float32(errors.map_noise**2), 0.0),
                errors.level,
            ))
        return layers

    def refine(
        self, layers: list[Layer], start: Pose2, *, pitch: float = 0.0, uneven: bool = False
    ) -> Fit:
        """
        Refine a pose.

        Parameters
        ----------
        layers : list of Layer
            The frame, from `layers`.
        start : Pose2
            Base in map, within about 0.2 m of the optimum.
        pitch : float
            Pitch relative to the calibration to start from, rad.
        uneven : bool
            The light varies over the road, and is found with the pose.

        Returns
        -------
        Fit
            The refined pose; `converged` is False where it cannot be believed.

        """
        state = RefinementState(start, np.array([pitch, 0.0, 0.0]))
        for _ in range(LIGHT_ROUNDS if uneven else 0):
            state.light = GaussNewton(layers[0], state, self._unknowns).lit()
        for layer in layers:
            coarser = state.pose
            gauss_newton = GaussNewton(layer, state, self._unknowns)
            problem = gauss_newton.run()
            if layer is layers[-1]:
                continue
            if uneven:
                state.light = GaussNewton(layer, state, self._unknowns).lit()
            elif self._unknowns.normalized:
                state.shading = gauss_newton.shaded(problem)
        drift = math.hypot(state.pose.x - start.x, state.pose.y - start.y)
        sums = problem.sums(self._stages[-1].blocks)
        spread = problem.block_covariance(sums)
        covariance = spread / _recognised(problem) + _beyond(coarser, state.pose, layers[-1])
        converged = (
            drift < MAX_DRIFT and _is_covariance(covariance) and settled(state.step, covariance)
        )
        find_shared = partial(self._shared, sums, state.pose)
        return _fit(
            problem, state, spread, covariance, find_shared, layers[-1], converged=converged
        )

    def _shared(self, sums: BlockSums, place: Pose2, level: ErrorLevel) -> SharedErrors:
        smooth = self._smooth_errors.shared(sums, level, place)
        return replace(smooth, covariance=smooth.covariance + self.mount)


def _of_mount_yaw(camera: Floats, sigma: float) -> Floats:
    """
    Covariance (3, 3) of the base from the camera's calibrated yaw.

    No frame shows this error: the camera is located and not the base, which is turned about the
    camera by it.

    Parameters
    ----------
    camera : (3,)
        Position of the camera in base, metres.
    sigma : float
        Standard deviation of the yaw, rad.

    """
    lever = sigma * np.array([camera[1], -camera[0], 1.0])
    return np.outer(lever, lever)


def _unknowns(camera_motion: CameraMotion, *, normalized: bool, robust: bool) -> Unknowns:
    sigmas = np.array(
        [camera_motion.sigma_pitch, camera_motion.sigma_roll, camera_motion.sigma_height]
    )
    moving: Ints = np.flatnonzero(sigmas > 0.0)
    exposed = 2 if normalized else 0
    prior = np.concatenate([np.zeros(3), 1.0 / sigmas[moving] ** 2, np.zeros(exposed)])
    return Unknowns(moving, prior, normalized, robust)


def _recognised(problem: LeastSquaresProblem) -> float:
    """
    Share of the road that agrees, relative to the share expected with noise alone; at most 1.

    Occluders are never rejected completely: the larger the occluded share, the more occluded
    cells are used as road. With cars in the view the errors are 1.3 times those estimated from
    the cells that agree; this share corrects for it. Where all of the road agrees it is 1.

    """
    return min(max(problem.inliers(), LEAST_INLIERS) / EXPECTED_INLIERS, 1.0)


def _beyond(coarser: Pose2, pose: Pose2, layer: Layer) -> Floats:
    """Covariance (3, 3) from sampling and from the difference between the last two stages."""
    locking = layer.locking
    change = difference(coarser.inverse() @ pose, Pose2(0.0, 0.0, 0.0))
    most = MOST_CHANGE * layer.raster_map.resolution
    change = change / max(np.hypot(change[0], change[1]) / most, 1.0)
    floor = np.diag([locking**2, locking**2, (0.2 * locking) ** 2])
    return np.asarray(floor + STAGE_SHARE * np.outer(change, change))


def _fit(
    problem: LeastSquaresProblem, state: RefinementState, spread: Floats, covariance: Floats,
    find_shared: Callable[[ErrorLevel], SharedErrors], layer: Layer, *, converged: bool,
) -> Fit:
    weight = float(layer.weights.sum(dtype=np.float64))
    known = float(layer.weights[problem.all_weights > 0.0].sum(dtype=np.float64))
    return Fit(
        pose=state.pose,
        own_covariance=covariance,
        find_shared=find_shared,
        level=layer.level,
        problem=problem,
        camera_motion=state.camera_motion,
        gain=problem.gain,
        offset=problem.offset,
        residual=problem.mean_square(),
        inliers=problem.inliers(),
        correlation=problem.correlation(),
        agreement=state.agreement,
        overlap=known / max(weight, 1e-20),
        converged=converged,
        chi_sq=problem.scale_sq,
        overdispersion=problem.overdispersion(spread),
        cell=max(layer.stage.resolution, layer.raster_map.resolution),
    )
