# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Light that varies over the road: edges of shadows, head lights, flicker, fog.

Brightness and contrast are estimated from the view itself, each as constant over a few cells. The
light model absorbs coarser map structure; only finer structure constrains the pose.

"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.refine.stages import Stage

# Standard deviation (cells of the view) of the filter that estimates the brightness (design
# choice: 4, because edges of shadows are sharp, and paint must not count as light).
BRIGHTNESS_SIDE = 4.0
# Standard deviation (cells of the view) of the filter that estimates the contrast (measured: in
# fog a larger neighbourhood than that of the brightness reduces the NEES from 55 to 4.4,
# docs/accuracy.md).
CONTRAST_SIDE = 16.0
# Limits of brightness and of contrast, in units of their means (design choice: from 0.05, because
# deep shadow and fog keep some light, to 4 and 2, because noise must not be amplified).
BRIGHTNESS, CONTRAST = (0.05, 4.0), (0.05, 2.0)
# Share of known cells (no unit) in the neighbourhood of a cell below which its mean shrinks
# towards 0 (design choice: 0.01, because a mean of so few cells is uncertain).
RIDGE = np.float32(0.01)
# Share of the mean brightness below which cells hardly constrain the brightness (no unit; design
# choice: 0.25, because the ratio to a dark cell amplifies the noise).
DARK = 0.25
# Share of the mean power of the pattern below which cells hardly constrain the contrast (no unit;
# design choice: 0.1, because a ratio of weak patterns is mostly noise).
FLAT = np.float32(0.1)


@dataclass(frozen=True, eq=False)
class Light:
    """
    The effect of the light on the map: `gain` times its grey level plus `veil`.

    Attributes
    ----------
    gain, veil : (rows, cols) float32
        On the road, in cells of any size.
    broad : (rows, cols) float32
        The part of the map that the light explains.

    """

    gain: Floats
    veil: Floats
    broad: Floats

    def on(self, stage: Stage) -> LightOnCells:
        """Return the light on the cells of a stage."""
        return LightOnCells(*map(stage.of_grid, (self.gain, self.veil, self.broad)))


@dataclass(frozen=True, eq=False)
class LightOnCells:
    """`Light` on n cells: (n,) float32 each."""

    gain: Floats
    veil: Floats
    broad: Floats


def find_light(stage: Stage, values: Floats, grey: Floats, known: Floats) -> Light:
    """
    Estimate the light of a view.

    All cells have equal weight: the Gramian's weights decrease with the distance and would shift
    the estimated light towards that of nearer cells.

    Parameters
    ----------
    stage : Stage
        Stage of the cells.
    values, grey, known : (n,) float32
        View less its offset and over its gain, the map, and 1 where both are known.

    """
    def mean(what: Floats, side: float) -> Floats:
        return _blurred(stage, known * what, side) / (_blurred(stage, known, side) + RIDGE)

    floor = np.float32(DARK * grey.mean() + 1e-6)
    ratio = np.maximum(values, 0.0) / np.maximum(grey, floor)
    brightness = np.clip(mean(ratio, BRIGHTNESS_SIDE), *BRIGHTNESS)
    broad = mean(grey, BRIGHTNESS_SIDE)
    lit = stage.of_grid(brightness)
    pattern = lit * (grey - stage.of_grid(broad))
    seen = values - stage.of_grid(mean(values, BRIGHTNESS_SIDE))
    power = mean(pattern * pattern, CONTRAST_SIDE)
    weak = FLAT * power.mean() + np.float32(1e-12)
    contrast = np.clip((mean(pattern * seen, CONTRAST_SIDE) + weak) / (power + weak), *CONTRAST)
    return Light(brightness * contrast, brightness * (1.0 - contrast) * broad, broad)


def _blurred(stage: Stage, values: Floats, side: float) -> Floats:
    return np.asarray(cv2.GaussianBlur(stage.on_grid(values), (0, 0), side / stage.factor))
