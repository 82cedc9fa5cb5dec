# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Low sun, shadows and rain, added to the scene before the sensor model.

Their shapes are chosen to look plausible; they are not models of measured weather.

"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Floats32 = NDArray[np.float32]

SOFT_EDGE = 1.5
"""Standard deviation, in px, of the Gaussian that blurs the edges of shadows; chosen."""


def add_glare(scene: Floats32, strength: float, bearing: float) -> None:
    """
    Add the glare of a low sun: bloom, reflection on the road and a uniform veil, in place.

    Parameters
    ----------
    scene : (rows, cols) float32
        Brightness.
    strength : float
        Brightness added in the centre of the bloom.
    bearing : float
        Column of the sun, as a fraction of the image width from the left edge.

    """
    rows, cols = scene.shape
    y, x = np.arange(rows, dtype=np.float32)[:, None], np.arange(cols, dtype=np.float32)[None, :]
    across = ((x - np.float32(bearing * cols)) / np.float32(0.16 * cols)) ** 2
    bloom = np.exp(-0.5 * (across + ((y - 0.12 * rows) / (0.35 * rows)) ** 2))
    streak = np.exp(-0.5 * across * 4.0) * np.exp(-0.5 * ((y - 0.5 * rows) / (0.3 * rows)) ** 2)
    scene += np.float32(strength) * (bloom + 0.5 * streak + 0.12)


def add_shadows(scene: Floats32, strength: float, rng: np.random.Generator) -> None:
    """Darken three strips, like shadows of houses and poles, by this fraction, in place."""
    rows, cols = scene.shape
    mask = np.zeros(scene.shape, np.uint8)
    for left, wide, slant in rng.uniform((0.0, 0.05, -1.0), (1.0, 0.4, 1.0), (3, 3)) * cols:
        strip = np.array([[left, 0], [left + wide, 0],
                          [left + wide + slant, rows], [left + slant, rows]])
        cv2.fillPoly(mask, [np.round(strip).astype(np.int32)], 255, cv2.LINE_AA)
    scene *= 1.0 - np.float32(strength / 255.0) * cv2.GaussianBlur(mask, (0, 0), SOFT_EDGE)


def add_rain(scene: Floats32, strength: float, rng: np.random.Generator) -> None:
    """Darken the wet scene and draw streaks of rain (strength 1 is a downpour), in place."""
    scene *= np.float32(1.0 - 0.3 * strength)
    scene += np.float32(0.08 * strength)
    rows, cols = scene.shape
    mask = np.zeros(scene.shape, np.uint8)
    starts = rng.uniform((-40.0, -40.0), (cols, rows), (round(400 * strength), 2))
    lengths = rng.uniform(10.0, 45.0, len(starts))
    for (u, v), length in zip(starts.tolist(), lengths.tolist(), strict=True):
        end = (round(16 * (u + 0.12 * length)), round(16 * (v + length)))
        cv2.line(mask, (round(16 * u), round(16 * v)), end, 255, 1, cv2.LINE_AA, 4)
    scene += mask * np.float32(0.12 * strength / 255.0)
