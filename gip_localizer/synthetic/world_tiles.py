# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's road: painted squares of mean grey plus or minus a, in random order."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]


def tiles(
    width: float,
    height: float,
    resolution: float,
    *,
    seed: int,
    side: float = 0.2,
    amplitude: float = 0.25,
    mean: float = 0.45,
) -> Floats32:
    """
    Return a raster of random squares, reflectance mean ± amplitude.

    The first square starts in the lower-left corner. A cell that several squares overlap holds
    their mean by area, so every side length is possible at every resolution. The defaults of
    amplitude and mean are chosen, the side of 0.2 m is the paper's.

    Parameters
    ----------
    width, height : float
        Size of the world, metres.
    resolution : float
        Metres per cell.
    seed : int
        Same seed, same squares.
    side : float
        Side of a square, metres.
    amplitude, mean : float
        Reflectances in [0, 1].

    Returns
    -------
    (rows, cols) float32

    """
    rows, cols = round(height / resolution), round(width / resolution)
    counts = math.ceil(rows * resolution / side) + 1, math.ceil(cols * resolution / side) + 1
    signs = np.random.default_rng(seed).integers(0, 2, counts) * 2.0 - 1.0
    shares_y = _shares(rows, counts[0], resolution / side)
    shares_x = _shares(cols, counts[1], resolution / side)
    pattern = shares_y @ signs @ shares_x.T
    return np.asarray(cv2.flip(mean + amplitude * pattern, 0), np.float32)


def _shares(cells: int, squares: int, step: float) -> NDArray[np.float64]:
    """Return the fraction (cells, squares) of each cell's length that lies in each square."""
    low = np.arange(cells)[:, None] * step
    edges = np.arange(squares)[None, :]
    overlap = np.minimum(low + step, edges + 1.0) - np.maximum(low, edges)
    return np.asarray(np.clip(overlap, 0.0, None) / step, float)
