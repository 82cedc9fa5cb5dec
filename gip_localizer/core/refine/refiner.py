# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Refinement of a lattice candidate to a continuous pose, by Gauss-Newton under the same norm.

The view is modelled as `v = a S û(pose, camera) + b + noise`, with the map û at the cells, the
pixel blur S of the camera (`Rectifier.pixel_blur`), gain a and offset b. With white pixel
noise the covariance of v is proportional to `S G⁻¹`, so the maximum-likelihood gradient is
`Jᵀ G (v - a S û - b)` and the Fisher information `Jᵀ G S J`: the paper's weights, exact also for
far cells that share pixels.

The first stages use averaged cells and a smoothed map, which widens the basin of convergence; the
last stage uses all cells, with the blur.

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
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.covariance_parts import recognized_share, sampling_covariance
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.refine.fit import Fit
from gip_localizer.core.refine.gauss_newton import GaussNewton, settled
from gip_localizer.core.refine.least_squares import LeastSquaresProblem
from gip_localizer.core.refine.observation import FrameErrors, Layer, RefinementState, Unknowns
from gip_localizer.core.refine.smooth_errors import BlockSums, SharedErrors, SmoothErrors
from gip_localizer.core.refine.stages import make_stages
from gip_localizer.parameters import CameraMotion

# Largest distance (m) of a converged pose from its start (design choice: 1 m, because starts are
# within 0.2 m of the optimum, and a farther pose is another mode).
MAX_DRIFT = 1.0
# Number of estimates of the light before the first step (design choice: 3, because light, gain and
# offset depend on each other).
LIGHT_ROUNDS = 3
# Largest pitch error (rad) from which the first stage converges (design choice: 0.005 rad, which
# displaces the road 6 m ahead of a camera at 1.5 m by 0.12 m).
PITCH_BASIN = 0.005


def _pitches(sigma: float) -> list[float]:
    """Return initial pitches, rad: the calibrated one first, then outwards to two sigmas."""
    count = int(2.0 * sigma / PITCH_BASIN)
    spacing = 2.0 * sigma / max(count, 1)
    return [0.0, *(sign * k * spacing for k in range(1, count + 1) for sign in (1, -1))]


def _is_covariance(matrix: Floats) -> bool:
    """Return whether a matrix is finite and positive definite."""
    return bool(np.isfinite(matrix).all() and np.linalg.eigvalsh(matrix).min() > 0.0)


class Refiner:
    """
    Refines the poses of frames with one calibration.

    Parameters
    ----------
    rectifier : Rectifier
        Rectifier with the cells and the pixel blur.
    camera_motion : CameraMotion
        Standard deviations of pitch, roll and height; zero: the component is fixed.
    normalized : bool
        True: gain and offset are unknown.
    robust : bool
        True: cells that disagree with the map lose their weight.
    constant_errors : (3, 3) float64 or None
        Covariance of x, y (m) and yaw (rad), in the axes of the pose, from errors that no frame
        shows and that do not average out: of the calibrated yaw and of the map. None: none.

    """

    def __init__(
        self, rectifier: Rectifier, camera_motion: CameraMotion, *, normalized: bool,
        robust: bool, constant_errors: Floats | None = None,
    ) -> None:
        self.camera = rectifier.camera
        self.pitches = _pitches(camera_motion.sigma_pitch)
        self._unknowns = _unknowns(camera_motion, normalized=normalized, robust=robust)
        self._stages = make_stages(rectifier)
        self._smooth_errors = SmoothErrors(
            self._stages[-1].block_centres, rectifier.camera.extrinsics.position()
        )
        self.constant_errors = np.zeros((3, 3)) if constant_errors is None else constant_errors

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
            Weight per cell: the diagonal of the Gramian.
        crop : Crop
            Part of the map that contains the view at all starts.
        errors : FrameErrors or None
            Known errors of the frame; None: a map without noise, and no earlier frame.
        stages : slice
            Stages that are prepared, coarse to fine.

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
                crop.blurred_slopes(stage.resolution) if calm else None,
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
            Cells of the frame, from `layers`.
        start : Pose2
            Pose of base in map, within about 0.2 m of the optimum.
        pitch : float
            Initial pitch relative to the calibration, rad.
        uneven : bool
            True: the light varies over the road and is estimated with the pose.

        Returns
        -------
        Fit
            The refined match; `converged` is False where it cannot be used.

        """
        state = RefinementState(start, np.array([pitch, 0.0, 0.0]))
        for _ in range(LIGHT_ROUNDS if uneven else 0):
            state.light = GaussNewton(layers[0], state, self._unknowns).estimate_light()
        for layer in layers:
            coarser = state.pose
            gauss_newton = GaussNewton(layer, state, self._unknowns)
            problem = gauss_newton.run()
            if layer is layers[-1]:
                continue
            if uneven:
                state.light = GaussNewton(layer, state, self._unknowns).estimate_light()
            elif self._unknowns.normalized:
                state.shading = gauss_newton.estimate_shading(problem)
        drift = math.hypot(state.pose.x - start.x, state.pose.y - start.y)
        sums = problem.sums(self._stages[-1].blocks)
        spread = problem.block_covariance(sums)
        covariance = spread / recognized_share(problem)
        covariance = covariance + sampling_covariance(coarser, state.pose, layers[-1])
        converged = (
            drift < MAX_DRIFT and _is_covariance(covariance) and settled(state.step, covariance)
        )
        find_shared = partial(self._shared, sums, state.pose)
        return _fit(
            problem, state, spread, covariance, find_shared, layers[-1], converged=converged
        )

    def _shared(self, sums: BlockSums, place: Pose2, level: ErrorLevel) -> SharedErrors:
        smooth = self._smooth_errors.shared(sums, level, place)
        return replace(smooth, covariance=smooth.covariance + self.constant_errors)


def _unknowns(camera_motion: CameraMotion, *, normalized: bool, robust: bool) -> Unknowns:
    sigmas = np.array(
        [camera_motion.sigma_pitch, camera_motion.sigma_roll, camera_motion.sigma_height]
    )
    moving: Ints = np.flatnonzero(sigmas > 0.0)
    exposed = 2 if normalized else 0
    prior = np.concatenate([np.zeros(3), 1.0 / sigmas[moving] ** 2, np.zeros(exposed)])
    return Unknowns(moving, prior, normalized, robust)


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
