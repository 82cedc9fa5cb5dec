# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Views and maps of texture for the score surface, and the score as a plain loop."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.ndimage import map_coordinates

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.score_surface import Lattice
from gip_localizer.core.pose import Pose2

GRID = Grid(6.0, 1.5, 40, 30, 0.1)
ANCHOR = Pose2(0.2, 0.1, 0.4)


def texture(shape: tuple[int, int], seed: int = 1, blur: float = 1.5) -> np.ndarray:
    grey = np.random.default_rng(seed).random(shape).astype(np.float32)
    grey = cv2.GaussianBlur(grey, (0, 0), blur)
    return (grey - grey.min()) / (grey.max() - grey.min())


def texture_map(*, hole: bool = False) -> RasterMap:
    grey = texture((200, 220))
    valid = None
    if hole:
        valid = np.ones(grey.shape, bool)
        valid[125:150, 165:180] = False
    return RasterMap(grey, 0.1, Pose2(-11.0, -10.0, 0.3), valid)


def weights(*, equal: bool, seed: int = 2) -> np.ndarray:
    if equal:
        weight = np.ones(GRID.shape, np.float32)
    else:
        near = np.linspace(0.01, 1.0, GRID.rows)[:, None] ** 3
        weight = (near * np.random.default_rng(seed).uniform(50, 100, GRID.shape)).astype('f4')
    weight[:6, :8] = 0.0  # outside of the view
    return weight


def view_from(raster_map: RasterMap, pose: Pose2, weight: np.ndarray, *, noise: float = 0.05,
              gain: float = 1.0, offset: float = 0.0, seed: int = 3) -> View:
    grey, _ = raster_map.sample(pose.transform(GRID.points()))
    patch = gain * grey.reshape(GRID.shape) + offset
    patch = patch + noise * np.random.default_rng(seed).standard_normal(GRID.shape)
    patch = np.where(weight > 0.0, patch, 0.0).astype(np.float32)
    return View(patch, weight, weight > 0.0, GRID)


def candidate_score(G: np.ndarray, V: np.ndarray, u: np.ndarray, *, normalized: bool) -> float:
    """The weighted mean square of one candidate, float64, as the definition says."""
    G, V, u = (np.asarray(a, float) for a in (G, V, u))
    if not normalized:
        return float((G * (V - u) ** 2).sum() / G.sum())
    mean_v, mean_u = (G * V).sum() / G.sum(), (G * u).sum() / G.sum()
    slope = (G * (V - mean_v) * (u - mean_u)).sum() / (G * (u - mean_u) ** 2).sum()
    gain = max(slope, 0.0)
    return float((G * (V - gain * u - (mean_v - gain * mean_u)) ** 2).sum() / G.sum())


def loop_scores(view: View, weight: np.ndarray, raster_map: RasterMap, lattice: Lattice, *,
                normalized: bool, min_overlap: float) -> tuple[np.ndarray, np.ndarray]:
    """Residual and overlap of a lattice of one yaw offset, 0, candidate by candidate."""
    assert list(lattice.yaws) == [0.0]
    residual, overlap = np.full(lattice.shape, np.inf), np.zeros(lattice.shape)
    for _, i, j in np.ndindex(lattice.shape):
        pose = lattice.pose(np.array([0.0, i, j]))
        u, known = raster_map.sample(pose.transform(view.grid.points()))
        G = np.where(known.reshape(weight.shape), weight, 0.0).astype(float)
        overlap[0, i, j] = G.sum() / weight.sum(dtype=float)
        if overlap[0, i, j] >= min_overlap:
            residual[0, i, j] = candidate_score(
                G, view.patch, u.reshape(weight.shape), normalized=normalized
            )
    return residual, overlap


def turned(plane: np.ndarray, grid: Grid, canvas: Grid, yaw: float) -> np.ndarray:
    """A plane of a view on the canvas of a turned anchor, bilinear, float64."""
    points = Pose2(0.0, 0.0, yaw).inverse().transform(canvas.points())
    row, col = grid.cell_of(points)
    values = map_coordinates(plane.astype(float), [row - 0.5, col - 0.5], order=1,
                             mode='grid-constant')
    return values.reshape(canvas.shape)
