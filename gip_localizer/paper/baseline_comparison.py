# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Beyond the paper: the task of a vehicle, solved by the norms and by other methods.

The paper compares two places on the lattice of the tiles. Here the place is unknown within a
window around a prior; in the second task the heading within ten degrees is unknown too; in the
third also the exposure. An estimate within half a tile of the truth is a success.

"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.gramian import gramian
from gip_localizer.core.match.score_surface import Lattice, make_lattice, match
from gip_localizer.core.pose import Pose2
from gip_localizer.paper.baseline_results import BeyondPoint
from gip_localizer.paper.baselines import (
    BaselineInput,
    ecc,
    ECC_CELL_M,
    ORB_CELL_M,
    orb_homography,
    PHASE_CELL_M,
    phase_correlation,
)
from gip_localizer.paper.geometry import PaperCamera
from gip_localizer.paper.pixel_camera import (
    CM,
    pixel_camera,
    pixel_noise,
    square_birdseye,
    tile_world,
)
from gip_localizer.parameters import Birdseye
from gip_localizer.synthetic.renderer import Renderer

AMPLITUDES = (2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0, 100.0, 300.0, 1000.0)
"""Amplitudes a of the tiles, in the paper's unit; chosen."""
WORLD_M, WORLD_RESOLUTION_M = 16.0, 0.01
"""Side and cell size of the road, metres; chosen."""
CELL_M = 0.05
"""Cell size of the view for the norms, and step of their lattice, metres; chosen."""
OFFSET_M, REACH_M = 0.5, 0.6
"""Largest offset of the truth from the prior, and half-width of the window, metres; chosen."""
YAW_OFFSET, YAW_REACH, YAW_STEP = math.radians(8.0), math.radians(10.0), math.radians(2.0)
"""Largest heading offset, half-width of the window and step, radians; chosen."""
GAINS, OFFSETS = (0.5, 1.5), (-0.2, 0.2)
"""Ranges of gain (no unit) and offset (fraction of full scale) of the exposure; chosen."""
DECAY = 1e-3
"""Decay of the weights with the squared distance, 1/m²: that of YabLoc."""
MIN_OVERLAP = 0.9
"""Least fraction of the view that the map must cover; chosen."""
Progress = Callable[[Iterable[Any]], Iterable[Any]]
Floats32 = NDArray[np.float32]


@dataclass(frozen=True)
class Task:
    """Unknowns in addition to the position."""

    name: str
    yaw: bool
    exposure: bool


TASKS = (
    Task('place', yaw=False, exposure=False),
    Task('place and yaw', yaw=True, exposure=False),
    Task('place, yaw and exposure', yaw=True, exposure=True),
)
NORMS = {  # method: (weights, gain and offset profiled out)
    'generalized': ('gramian', False),
    'standard': ('equal', False),
    'distance decay': ('decay', False),
    'normalized generalized': ('gramian', True),
    'normalized standard': ('equal', True),
    'normalized distance decay': ('decay', True),
}
# method: (function, cell)
BASELINES: dict[str, tuple[Callable[[BaselineInput], Pose2 | None], float]] = {
    'ORB + homography': (orb_homography, ORB_CELL_M),
    'phase correlation': (phase_correlation, PHASE_CELL_M),
    'ECC': (ecc, ECC_CELL_M),
}
METHODS = (*NORMS, *BASELINES)


def run_beyond(
    camera: PaperCamera, seed: int, progress: Progress = iter, *,
    amplitudes: tuple[float, ...] = AMPLITUDES, trials: int,
) -> list[BeyondPoint]:
    """
    Measure the success rates of all methods.

    Parameters
    ----------
    camera : PaperCamera
        Camera, noise and squares.
    seed : int
        Seed of road, positions, exposures and noise.
    progress : callable
        Wraps the iteration over pairs of trial and task.
    amplitudes : tuple of float
        The paper's a. The contrast of the road is constant; the noise is scaled to give this a.
    trials : int
        Number of positions; each gives a frame per task and amplitude.

    Returns
    -------
    list of BeyondPoint
        One point per task, amplitude and method.

    """
    bench = _BaselineBench(camera, seed)
    wins = {(t.name, a, m): 0 for t in TASKS for a in amplitudes for m in METHODS}
    for trial, task in progress([(k, task) for k in range(trials) for task in TASKS]):
        place = bench.place(task, trial)
        for amplitude in amplitudes:
            for method, success in bench.judge(place, amplitude).items():
                wins[task.name, amplitude, method] += success
    return [
        BeyondPoint(task=task, amplitude=a, method=method, trials=trials, successes=count)
        for (task, a, method), count in wins.items()
    ]


@dataclass(frozen=True, eq=False)
class _BaselineTrial:
    """An image without noise, the prior, the truth relative to it, and the heading window."""

    image: Floats32
    prior: Pose2
    truth: Pose2
    yaw_reach: float


class _BaselineBench:
    """Test bench: road, camera, rectifiers, weights, and the random numbers of the trials."""

    def __init__(self, camera: PaperCamera, seed: int) -> None:
        self._camera = camera
        self._seed, self._rng = seed, np.random.default_rng(seed)
        self._map = tile_world(
            camera, size=WORLD_M, resolution=WORLD_RESOLUTION_M, seed=seed
        ).fine
        model = pixel_camera(camera)
        self._renderer = Renderer(self._map, model)
        view = square_birdseye(camera)
        self._rectifiers = {
            cell: Rectifier(model, Birdseye(view.near, view.far, view.half_width, cell))
            for cell in {CELL_M, *(cell for _, cell in BASELINES.values())}
        }
        self._half_tile = 0.5 * camera.square * CM

    def place(self, task: Task, trial: int) -> _BaselineTrial:
        """Draw prior, truth and exposure (the same for each task), and render the image."""
        rng, margin = np.random.default_rng((self._seed, trial)), 5.0
        prior = Pose2(
            rng.uniform(margin, WORLD_M - margin), rng.uniform(margin, WORLD_M - margin),
            rng.uniform(-math.pi, math.pi),
        )
        x, y, yaw = rng.uniform(-1.0, 1.0, 3) * (OFFSET_M, OFFSET_M, YAW_OFFSET * task.yaw)
        gain, offset = rng.uniform(*GAINS), rng.uniform(*OFFSETS)
        truth = Pose2(float(x), float(y), float(yaw))
        image = self._renderer.render(prior @ truth)
        if task.exposure:
            image = np.float32(gain) * image + np.float32(offset)
        return _BaselineTrial(image, prior, truth, YAW_REACH * task.yaw)

    def judge(self, place: _BaselineTrial, amplitude: float) -> dict[str, bool]:
        """Add noise to the image, and return for each method whether it succeeds."""
        noise = pixel_noise(self._camera, amplitude)
        image = np.float32(noise) * self._rng.standard_normal(place.image.shape, np.float32)
        image += place.image
        views = {cell: rect.rectify(image) for cell, rect in self._rectifiers.items()}
        found = self._by_norms(views[CELL_M], place, noise)
        for name, (localize, cell) in BASELINES.items():
            found[name] = localize(self._scene(views[cell], place))
        return {
            name: pose is not None
            and math.hypot(pose.x - place.truth.x, pose.y - place.truth.y) <= self._half_tile
            for name, pose in found.items()
        }

    def _scene(self, view: View, place: _BaselineTrial) -> BaselineInput:
        return BaselineInput(view, self._map, place.prior, REACH_M, self._lattice(place).yaws)

    def _lattice(self, place: _BaselineTrial) -> Lattice:
        return make_lattice(
            place.prior, x=REACH_M, y=REACH_M, yaw=place.yaw_reach, yaw_step=YAW_STEP, step=CELL_M
        )

    def _by_norms(
        self, view: View, place: _BaselineTrial, noise: float
    ) -> dict[str, Pose2 | None]:
        lattice = self._lattice(place)
        points = place.prior.transform(view.grid.corners())
        nearby = self._map.crop(points, margin=2.0 * REACH_M, cell=CELL_M)
        weights = _weights(view, noise)
        found: dict[str, Pose2 | None] = {}
        for name, (weight, normalized) in NORMS.items():
            scores = match(
                view, weights[weight], nearby or self._map, lattice, normalized=normalized,
                min_overlap=MIN_OVERLAP,
            )
            found[name] = lattice.offset(np.array(scores.best(), float))
        return found


def _weights(view: View, noise: float) -> dict[str, Floats32]:
    """Return three weights: the Gramian, equal weights, and weights that decay with distance."""
    equal = view.valid.astype(np.float32)
    distance_sq = (view.grid.points() ** 2).sum(axis=1).reshape(view.grid.shape)
    return {
        'gramian': gramian(view.footprint, pixel_noise=noise, map_noise=0.0),
        'equal': equal,
        'decay': (equal * np.exp(-DECAY * distance_sq)).astype(np.float32),
    }
