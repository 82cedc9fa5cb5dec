# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Which part of which pixel sees which road cell: the overlap matrix, once per calibration.

Entry (cell, pixel) is the share of the pixel's area that lies on the cell. Pixels that lie
inside one cell are recognized by their corners; the others are divided into sub-pixels.

"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.interpolate import RectBivariateSpline

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.model import CameraModel

# Distance (px) between rays that are undistorted exactly; a cubic spline interpolates the others
# (design choice: 4, because lens models are smooth over some pixels).
RAY_GRID_STEP = 4
# Number of sub-pixels per side of a pixel that is narrower than a cell (design choice: 4, because
# its footprint is then accurate to a sixteenth).
SUBPIXELS = 4
# Number of sub-pixels per side of a pixel that spans more than half a cell (design choice: 8,
# because such pixels are shared by several cells).
SUBPIXELS_FAR = 8
# Number of parts of a pixel in which its shares are counted: the sub-pixels of a far pixel.
PARTS = SUBPIXELS_FAR**2
# Number of pixels that are divided at once (design choice: 50,000, which bounds the memory).
CHUNK = 50_000




def footprint_areas(camera: CameraModel, grid: Grid) -> tuple[Floats, Bools]:
    """
    Area of each cell in the image (the paper's Ã, TildeA, here for any pose and lens).

    Returns
    -------
    area : (rows, cols) float64
        Square pixels; 0 where not valid.
    valid : (rows, cols) bool
        The whole cell is in the image.

    """
    uv, seen = camera.project(grid.corners())
    uv = uv.reshape(grid.rows + 1, grid.cols + 1, 2)
    size = np.array([camera.width, camera.height])
    inside = seen & ((uv > -0.5) & (uv < size - 0.5)).all(axis=-1).ravel()
    inside = inside.reshape(uv.shape[:2])
    valid: Bools = inside[:-1, :-1] & inside[1:, :-1] & inside[:-1, 1:] & inside[1:, 1:]
    first = uv[1:, 1:] - uv[:-1, :-1]
    second = uv[1:, :-1] - uv[:-1, 1:]
    area = 0.5 * np.abs(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
    return np.where(valid, area, 0.0), valid


@dataclass(frozen=True, eq=False)
class PixelBox:
    """The rectangle of pixels that the view touches: first column and row, width, height."""

    u: int
    v: int
    width: int
    height: int

    @property
    def slices(self) -> tuple[slice, slice]:
        """Row and column slices of the image."""
        return slice(self.v, self.v + self.height), slice(self.u, self.u + self.width)


def pixel_box(camera: CameraModel, grid: Grid, valid: Bools) -> PixelBox:
    """Return the rectangle of pixels that the valid cells touch."""
    uv, _ = camera.project(grid.corners())
    uv = uv.reshape(grid.rows + 1, grid.cols + 1, 2)
    used = np.zeros(uv.shape[:2], bool)
    for rows in (slice(0, -1), slice(1, None)):
        for cols in (slice(0, -1), slice(1, None)):
            used[rows, cols] |= valid
    low = np.maximum(np.floor(uv[used].min(axis=0) + 0.5).astype(int), 0)
    high = np.minimum(
        np.ceil(uv[used].max(axis=0) + 0.5).astype(int), [camera.width, camera.height]
    )
    width, height = (int(n) for n in high - low)
    return PixelBox(int(low[0]), int(low[1]), width, height)


def overlap_matrix(
    camera: CameraModel, grid: Grid, valid: Bools, box: PixelBox
) -> sparse.csr_matrix:
    """
    Share of each pixel's area on each cell.

    Returns
    -------
    (rows * cols, box.height * box.width) sparse float32
        Rows of cells that are not valid are empty; a full row sums to the cell's footprint.
        Entries are whole numbers of `PARTS`, in the order of pixels.

    """
    rays, exists = _corner_rays(camera, box)
    xy, on_road = camera.intersect_road(rays, exists)
    shape = (box.height + 1, box.width + 1)
    rays, on_road = rays.reshape(*shape, 2), on_road.reshape(shape)
    row, col = (np.floor(k).reshape(shape) for k in grid.cell_of(np.nan_to_num(xy, nan=1e9)))
    corners = [(slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)),
               (slice(None, -1), slice(1, None)), (slice(1, None), slice(1, None))]
    low_row, high_row = _extremes(row, corners)
    low_col, high_col = _extremes(col, corners)
    touches = np.logical_and.reduce([on_road[c] for c in corners]) & (
        (high_row >= 0) & (low_row < grid.rows) & (high_col >= 0) & (low_col < grid.cols)
    )
    span = np.maximum(high_row - low_row, high_col - low_col)
    parts = [_whole_pixels(grid, low_row, low_col, touches & (span == 0))]
    divided = [(touches & (span == 1), SUBPIXELS), (touches & (span > 1), SUBPIXELS_FAR)]
    for chosen, side in divided:
        pixels = np.flatnonzero(chosen)
        for start in range(0, len(pixels), CHUNK):
            chunk = pixels[start : start + CHUNK]
            parts.append(_divided_pixels(camera, grid, rays, chunk, side))
    cells, pixels, shares = (np.concatenate(column) for column in zip(*parts, strict=True))
    keep = valid.ravel()[cells]
    matrix = sparse.coo_matrix(
        (shares[keep], (cells[keep], pixels[keep])),
        shape=(grid.rows * grid.cols, box.height * box.width), dtype=np.float32,
    )
    made = matrix.tocsr()
    made.sort_indices()
    return made


def _extremes(index: Floats, corners: list[tuple[slice, slice]]) -> tuple[Floats, Floats]:
    stacked = [index[c] for c in corners]
    return np.minimum.reduce(stacked), np.maximum.reduce(stacked)


def _corner_rays(camera: CameraModel, box: PixelBox) -> tuple[Floats, Bools]:
    """Rays ((h + 1) * (w + 1), 2) through the pixel corners of the box, row by row."""
    u = box.u - 0.5 + np.arange(box.width + 1)
    v = box.v - 0.5 + np.arange(box.height + 1)
    steps_u = np.linspace(u[0], u[-1], max(box.width // RAY_GRID_STEP, 4) + 1)
    steps_v = np.linspace(v[0], v[-1], max(box.height // RAY_GRID_STEP, 4) + 1)
    coarse = np.stack(np.meshgrid(steps_u, steps_v), axis=-1).reshape(-1, 2)
    rays, valid = camera.rays(coarse)
    if camera.D.size == 0 or not valid.all():
        return camera.rays(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    planes = rays.reshape(len(steps_v), len(steps_u), 2)
    filled = [RectBivariateSpline(steps_v, steps_u, planes[..., k])(v, u) for k in (0, 1)]
    full = np.stack(filled, axis=-1).reshape(-1, 2)
    return full, np.ones(len(full), bool)


Entries = tuple[NDArray[np.int64], NDArray[np.int64], Floats]


def _whole_pixels(grid: Grid, row: Floats, col: Floats, chosen: Bools) -> Entries:
    pixels = np.flatnonzero(chosen)
    cells = (row.ravel()[pixels] * grid.cols + col.ravel()[pixels]).astype(np.int64)
    return cells, pixels, np.ones(len(pixels), np.float32)


def _divided_pixels(
    camera: CameraModel, grid: Grid, rays: Floats, pixels: NDArray[np.int64], side: int
) -> Entries:
    """Distribute pixels over cells by side x side sub-pixels (rays bilinear in the pixel)."""
    width = rays.shape[1] - 1
    v, u = np.divmod(pixels, width)
    corners = [rays[v + dv, u + du] for dv in (0, 1) for du in (0, 1)]
    t = (np.arange(side) + 0.5) / side
    cells, shares = [], np.float32(1.0 / side**2)
    for b in t:
        for a in t:
            weights = ((1 - b) * (1 - a), (1 - b) * a, b * (1 - a), b * a)
            ray = sum(w * c for w, c in zip(weights, corners, strict=True))
            xy, _ = camera.intersect_road(np.asarray(ray), np.ones(len(pixels), bool))
            row, col = (np.floor(k) for k in grid.cell_of(np.nan_to_num(xy, nan=1e9)))
            inside = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
            cells.append(np.where(inside, row * grid.cols + col, -1).astype(np.int64))
    cell = np.concatenate(cells)
    pixel = np.tile(pixels, side * side)
    kept = cell >= 0
    return cell[kept], pixel[kept], np.full(int(kept.sum()), shares, np.float32)
