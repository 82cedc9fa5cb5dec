# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Seeded noise textures with a grain size in metres, independent of the raster's resolution.

Value noise: normal random numbers on a coarse lattice, interpolated bicubically. A sum of octaves
looks like asphalt; a threshold on one octave looks like wear.

"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]


def value_noise(
    shape: tuple[int, int], resolution: float, scale: float, rng: np.random.Generator
) -> Floats32:
    """
    Return smooth noise of unit variance with a grain size of `scale` metres.

    Parameters
    ----------
    shape : (int, int)
        Rows and columns of the raster.
    resolution : float
        Metres per cell.
    scale : float
        Lattice spacing, metres. Below one cell the noise is white.
    rng : numpy.random.Generator
        Source of the lattice values.

    Returns
    -------
    (rows, cols) float32

    """
    step = resolution / scale
    if step >= 1.0:
        return rng.standard_normal(shape, dtype=np.float32)
    rows, cols = (int(np.ceil(size * step)) + 4 for size in shape)
    lattice = rng.standard_normal((rows, cols), dtype=np.float32)
    offset = 1.5 + 0.5 * step
    to_lattice = np.array([[step, 0.0, offset], [0.0, step, offset]])
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    noise = cv2.warpAffine(lattice, to_lattice, shape[::-1], flags=flags)
    return np.asarray(noise / max(float(noise.std()), 1e-6), np.float32)


def octaves(
    shape: tuple[int, int],
    resolution: float,
    grains: Sequence[tuple[float, float]],
    rng: np.random.Generator,
) -> Floats32:
    """Return the sum of value noises; `grains` holds (scale in metres, standard deviation)."""
    total = np.zeros(shape, np.float32)
    for scale, deviation in grains:
        total += np.float32(deviation) * value_noise(shape, resolution, scale, rng)
    return total


def smooth_step(values: Floats32, low: float, high: float) -> Floats32:
    """Return 0 below `low`, 1 above `high`, with a smooth cubic between them."""
    t = np.clip((values - np.float32(low)) / np.float32(high - low), 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t), np.float32)
