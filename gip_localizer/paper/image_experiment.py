# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The paper's experiment on images: measured error rates compared with the theory.

In each trial the paper's camera renders a place u* of a road of random tiles, white noise is added
to every pixel, and the frame is processed with the rectifier, Gramian and scores of the package.
The trial is an error if a place û, drawn from the neighbouring places, scores better than u*. The
rate of the theory is the mean of the general P(error) over the same pairs.

For comparison, a second rectifier takes one bilinear sample at the centre of each square instead
of the mean over its footprint.

"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.gramian import gramian
from gip_localizer.core.match.score_surface import Lattice, match
from gip_localizer.core.pose import Pose2
from gip_localizer.paper.geometry import PaperCamera
from gip_localizer.paper.image_results import PipelinePoint
from gip_localizer.paper.pixel_camera import (
    aligned_pose,
    paper_squares,
    pixel_camera,
    pixel_noise,
    square_birdseye,
    tile_world,
)
from gip_localizer.paper.squares import visible_squares
from gip_localizer.paper.theory import error_generalized, error_standard
from gip_localizer.synthetic.renderer import Renderer

AMPLITUDES = (0.1, 0.25, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
"""Amplitudes a of the tiles, in the paper's unit; chosen."""
WORLD_M, WORLD_RESOLUTION_M = 8.0, 0.0025
"""Side and cell size of the road, metres; chosen."""
REACH = 3
"""Largest distance of the competing place along and across the road, tiles; chosen."""
RECTIFIERS = ('footprint mean', 'point sample')
FORMULAS = {'generalized': error_generalized, 'standard': error_standard}
Progress = Callable[[Iterable[Any]], Iterable[Any]]
Floats32 = NDArray[np.float32]


def run_pipeline(
    camera: PaperCamera, seed: int, progress: Progress = iter, *,
    amplitudes: tuple[float, ...] = AMPLITUDES, trials: int,
) -> list[PipelinePoint]:
    """
    Measure the error rates on rendered frames.

    Parameters
    ----------
    camera : PaperCamera
        Camera, noise and squares.
    seed : int
        Seed of road, places and noise.
    progress : callable
        Wraps the iteration over trials.
    amplitudes : tuple of float
        The paper's a.
    trials : int
        Number of places; each gives a frame per amplitude.

    Returns
    -------
    list of PipelinePoint
        For each amplitude both inner products with both rectifiers.

    """
    bench = _TileBench(camera, seed)
    errors = {(a, name, how): 0 for a in amplitudes for name in FORMULAS for how in RECTIFIERS}
    theory = {(a, name): 0.0 for a in amplitudes for name in FORMULAS}
    for _ in progress(range(trials)):
        place = bench.place()
        for amplitude in amplitudes:
            for key, wrong in bench.judge(place, amplitude).items():
                errors[(amplitude, *key)] += wrong
            for name, probability in bench.theory(place, amplitude).items():
                theory[amplitude, name] += probability / trials
    return [
        PipelinePoint(
            amplitude=a, inner_product=name, rectifier=how, trials=trials, errors=count,
            theory=theory[a, name],
        )
        for (a, name, how), count in errors.items()
    ]


@dataclass(frozen=True, eq=False)
class _TileTrial:
    """A true place with its image without noise, the candidates around it, and the competitor."""

    image: Floats32
    lattice: Lattice
    other: tuple[int, int]
    truth_tiles: Floats  # u*, (m,)
    other_tiles: Floats  # û, (m,)


class _TileBench:
    """Test bench: road, camera and rectifiers, and the random numbers of the trials."""

    def __init__(self, camera: PaperCamera, seed: int) -> None:
        self._camera = camera
        self._rng = np.random.default_rng(seed)
        self._world = tile_world(camera, size=WORLD_M, resolution=WORLD_RESOLUTION_M, seed=seed)
        model = pixel_camera(camera)
        self._renderer = Renderer(self._world.fine, model)
        self._rectifier = Rectifier(model, square_birdseye(camera))
        self._chosen = paper_squares(visible_squares(camera), self._rectifier.grid)
        self._footprint = np.where(self._chosen, self._rectifier.footprint, np.float32(0.0))
        self._sampler = point_sampler(self._rectifier)

    def place(self) -> _TileTrial:
        """Draw a place and a competing place, at most `REACH` tiles away."""
        pose = aligned_pose(self._world, self._rectifier, REACH + 1, self._rng)
        lattice = Lattice(pose, self._world.coarse.resolution, (REACH, REACH), np.zeros(1))
        side = 2 * REACH + 1
        index = int(self._rng.integers(side * side - 1))
        other = divmod(index + (index >= side * side // 2), side)
        return _TileTrial(
            self._renderer.render(pose), lattice, other, self._tiles_at(pose),
            self._tiles_at(lattice.pose(np.array([0.0, *other]))),
        )

    def judge(self, place: _TileTrial, amplitude: float) -> dict[tuple[str, str], bool]:
        """Add noise to the image, and return which combinations choose the competing place."""
        noise = pixel_noise(self._camera, amplitude)
        image = np.float32(noise) * self._rng.standard_normal(place.image.shape, np.float32)
        image += place.image
        views = (self._rectifier.rectify(image), self._sampler(image))
        weights = {
            'generalized': gramian(self._footprint, pixel_noise=noise, map_noise=0.0),
            'standard': (self._footprint > 0.0).astype(np.float32),
        }
        return {
            (name, how): self._is_wrong(view, weight, place)
            for name, weight in weights.items()
            for how, view in zip(RECTIFIERS, views, strict=True)
        }

    def theory(self, place: _TileTrial, amplitude: float) -> dict[str, float]:
        """Return P(error) for the pair of the trial."""
        area = self._footprint[self._chosen].astype(float)
        constant = pixel_noise(self._camera, amplitude) ** -2  # 1/N0, with Ã for G
        return {
            name: float(formula(place.truth_tiles, place.other_tiles, area, constant))
            for name, formula in FORMULAS.items()
        }

    def _is_wrong(self, view: View, weight: Floats32, place: _TileTrial) -> bool:
        scores = match(
            view, weight, self._world.coarse, place.lattice, normalized=False,
            min_overlap=1.0 - 1e-6,
        )
        return bool(scores.residual[(0, *place.other)] < scores.residual[0, REACH, REACH])

    def _tiles_at(self, pose: Pose2) -> Floats:
        """Return the map at the squares that are seen from a pose, (m,)."""
        points = self._rectifier.grid.points()[self._chosen.ravel()]
        values, _ = self._world.coarse.sample(pose.transform(points))
        return values.astype(float)


def point_sampler(rectifier: Rectifier) -> Callable[[Floats32], View]:
    """Return the naive rectifier: `cv2.warpPerspective`, one bilinear sample per cell centre."""
    grid, camera = rectifier.grid, rectifier.camera
    centres = grid.points().reshape(grid.rows, grid.cols, 2)
    cells = np.array([[0, 0], [grid.cols - 1, 0], [grid.cols - 1, grid.rows - 1],
                      [0, grid.rows - 1]], np.float32)
    rows, cols = cells[:, 1].astype(int), cells[:, 0].astype(int)
    pixels, _ = camera.project(centres[rows, cols])
    H = cv2.getPerspectiveTransform(cells, pixels.astype(np.float32))

    def sample(image: Floats32) -> View:
        patch = cv2.warpPerspective(
            image, H, (grid.cols, grid.rows), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
        )
        patch = np.where(rectifier.valid, patch, np.float32(0.0))
        return View(patch, rectifier.footprint, rectifier.valid, grid)

    return sample
