# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Baseline methods on the same view and map: ORB, phase correlation, ECC.

Each method gets the bird's-eye view and the map around the prior, in the axes of the prior. Cell
size and smoothing are the best of those tried for each method. Each returns the pose of base
relative to the prior, or None.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2

Floats32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]

ORB_SMOOTHING_M, ECC_SMOOTHING_M = 0.04, 0.02
"""Standard deviations of the smoothing against noise, metres; the best of those tried."""
ORB_CELL_M, PHASE_CELL_M, ECC_CELL_M = 0.01, 0.05, 0.02
"""Cell sizes, metres; the best of those tried (the patches of ORB need small cells)."""
RANSAC_PX = 3.0
"""Largest reprojection error of a RANSAC inlier, px: OpenCV's default."""
MIN_MATCHES = 6
"""Least number of feature matches for a homography; chosen above the minimum of 4."""
ECC_BLURS = (41, 11)
"""Sizes of the Gaussian filters of the coarse and the fine run, px; chosen."""
ECC_STOP = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-5)
"""Stop after 60 iterations or at a change of the correlation below 1e-5; chosen."""


@dataclass(frozen=True, eq=False)
class BaselineInput:
    """
    A view and the map around its prior.

    Attributes
    ----------
    view : View
        Bird's-eye view.
    raster_map : RasterMap
        The map.
    anchor : Pose2
        Prior pose of base in map.
    reach : float
        Half-width of the window, metres.
    yaws : (n,) float64
        Candidate headings relative to the prior, radians.

    """

    view: View
    raster_map: RasterMap
    anchor: Pose2
    reach: float
    yaws: Floats

    def surroundings(self) -> Grid:
        """Return the grid of the view, enlarged by the window."""
        grid, cells = self.view.grid, math.ceil(self.reach / self.view.grid.resolution)
        margin = cells * grid.resolution
        return Grid(
            grid.far + margin, grid.left + margin, grid.rows + 2 * cells, grid.cols + 2 * cells,
            grid.resolution,
        )

    def map_picture(self, grid: Grid, smoothing: float = 0.0) -> Floats32:
        """Return the map on a grid in the prior's axes, smoothed by `smoothing` metres."""
        values, _ = self.raster_map.sample(self.anchor.transform(grid.points()))
        return _smooth(values.reshape(grid.shape), smoothing / grid.resolution)

    def view_picture(self, smoothing: float = 0.0) -> Floats32:
        """Return the view, smoothed by `smoothing` metres; cells not seen hold its mean."""
        view = self.view
        mean = view.patch[view.valid].mean()
        filled = np.where(view.valid, view.patch, mean)
        return _smooth(filled, smoothing / view.grid.resolution)


def orb_homography(scene: BaselineInput) -> Pose2 | None:
    """Match ORB features of view and map; the pose follows from the RANSAC homography."""
    orb = cv2.ORB_create(nfeatures=1000, fastThreshold=7)  # type: ignore[attr-defined]
    around = scene.surroundings()
    inside = cv2.erode(scene.view.valid.astype(np.uint8), np.ones((9, 9), np.uint8))
    picture = _bytes(scene.view_picture(ORB_SMOOTHING_M))
    map_picture = _bytes(scene.map_picture(around, ORB_SMOOTHING_M))
    points, codes = orb.detectAndCompute(picture, inside * 255)
    map_points, map_codes = orb.detectAndCompute(map_picture, None)
    if codes is None or map_codes is None:
        return None
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(codes, map_codes)
    if len(matches) < MIN_MATCHES:
        return None
    source = np.array([points[m.queryIdx].pt for m in matches], np.float32)
    target = np.array([map_points[m.trainIdx].pt for m in matches], np.float32)
    H, _ = cv2.findHomography(source, target, cv2.RANSAC, RANSAC_PX, maxIters=1000)
    if H is None:
        return None
    return _pose(_to_metres(around) @ H @ np.linalg.inv(_to_metres(scene.view.grid)), scene)


def phase_correlation(scene: BaselineInput) -> Pose2 | None:
    """Phase-correlate view and map at every heading; return the strongest response."""
    around, step = scene.surroundings(), scene.view.grid.resolution
    world = scene.map_picture(around).astype(np.float64)
    world -= world.mean()
    picture = scene.view_picture()
    picture = np.where(scene.view.valid, picture - picture.mean(), 0.0)
    best, found = -math.inf, None
    for yaw in scene.yaws:
        turned = _turned(picture, scene.view.grid, around, float(yaw))
        (right, down), response = cv2.phaseCorrelate(turned, world)
        pose = Pose2(-down * step, -right * step, float(yaw))
        if response > best and max(abs(pose.x), abs(pose.y)) <= scene.reach:
            best, found = response, pose
    return found


def ecc(scene: BaselineInput) -> Pose2 | None:
    """Align with `cv2.findTransformECC`, coarse to fine from the prior: a local method."""
    grid = scene.view.grid
    world = scene.map_picture(grid, ECC_SMOOTHING_M)
    picture = scene.view_picture(ECC_SMOOTHING_M)
    mask = scene.view.valid.astype(np.uint8) * 255
    warp = np.eye(2, 3, dtype=np.float32)
    try:
        for blur in ECC_BLURS:
            _, warp = cv2.findTransformECC(
                world, picture, warp, cv2.MOTION_EUCLIDEAN, ECC_STOP, mask, blur
            )
    except cv2.error:
        return None  # raised if it does not converge
    full = np.vstack([np.asarray(warp, float), [0.0, 0.0, 1.0]])
    metres = _to_metres(grid)
    return _pose(np.linalg.inv(metres @ full @ np.linalg.inv(metres)), scene)


def _smooth(values: Floats32, sigma: float) -> Floats32:
    if sigma <= 0.0:
        return values.astype(np.float32)
    blurred = cv2.GaussianBlur(
        values.astype(np.float32), (0, 0), sigma, borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(blurred, np.float32)


def _bytes(values: Floats32) -> Bytes:
    """Return a picture of 8 bits that covers three standard deviations around the mean."""
    mean, spread = float(values.mean()), max(float(values.std()), 1e-6)
    stretched = 127.5 + (values - mean) * (127.5 / (3.0 * spread))
    return np.asarray(np.clip(stretched, 0.0, 255.0), np.uint8)


def _to_metres(grid: Grid) -> Floats:
    """Return the matrix (3, 3) from (column, row, 1) of a picture to (x, y, 1) in metres."""
    step = grid.resolution
    return np.array([
        [0.0, -step, grid.far - 0.5 * step], [-step, 0.0, grid.left - 0.5 * step],
        [0.0, 0.0, 1.0],
    ])


def _turned(picture: Floats, grid: Grid, around: Grid, yaw: float) -> Floats:
    """Return the view rotated about base by a yaw, on the enlarged grid."""
    c, s = math.cos(yaw), math.sin(yaw)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    affine = np.linalg.inv(_to_metres(around)) @ turn @ _to_metres(grid)
    size = (around.cols, around.rows)
    return np.asarray(cv2.warpAffine(picture, affine[:2], size, flags=cv2.INTER_LINEAR), float)


def _pose(T_anchor_base: Floats, scene: BaselineInput) -> Pose2 | None:
    """Return the pose of a plane transform at the view's centre; None outside the window."""
    grid = scene.view.grid
    ahead = grid.far - 0.5 * grid.rows * grid.resolution
    ends = T_anchor_base @ np.array([[ahead - 0.1, ahead + 0.1], [0.0, 0.0], [1.0, 1.0]])
    if not np.all(np.abs(ends[2]) > 1e-9):
        return None
    (x0, x1), (y0, y1) = ends[:2] / ends[2]
    yaw = math.atan2(y1 - y0, x1 - x0)
    x = 0.5 * (x0 + x1) - ahead * math.cos(yaw)
    y = 0.5 * (y0 + y1) - ahead * math.sin(yaw)
    inside = max(abs(x), abs(y)) <= scene.reach
    return Pose2(float(x), float(y), yaw) if inside else None
