# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Light that differs from place to place: edges of shadows, head lights, flicker.

The light is learnt from the view itself, as the same over a few cells. What is broader than
that in the map tells nothing any more; the pattern does.

"""

from __future__ import annotations

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.stages import Stage

SIDE = 4.0  # cells of the view (standard deviation) over which the light counts as the same
LIMITS = (0.05, 4.0)  # of the light over its mean
RIDGE = np.float32(0.01)  # share of seen cells below which the light is even
DARK = 0.25  # of the mean brightness, below which cells tell little of the light


def light(stage: Stage, values: Floats, brightness: Floats, known: Floats) -> Floats:
    """
    How the light varies over the road, (rows, cols) float32, about 1.

    All cells count alike: with the Gramian's weights, which fall with the distance, the light
    of a place would be that of a nearer one.

    Parameters
    ----------
    stage : Stage
        Whose cells they are.
    values, brightness, known : (n,) float32
        View less its offset, what even light makes of the map, and 1 where both are known.

    """
    floor = np.float32(DARK * brightness.mean() + 1e-6)
    ratio = known * np.maximum(values, 0.0) / np.maximum(brightness, floor)
    lit, seen = (_blurred(stage, what) for what in (ratio, known))
    return np.clip((lit + RIDGE) / (seen + RIDGE), *LIMITS)


def pattern(stage: Stage, predicted: Floats, shade: Floats, known: Floats) -> Floats:
    """What of a prediction (n,) under a light (n,) the light does not explain."""
    plain = predicted / shade
    mean, total = (_blurred(stage, what) for what in (known * plain, known))
    broad = stage.of_grid(mean / np.maximum(total, np.float32(1e-20)))
    return np.asarray(shade * (plain - broad))


def _blurred(stage: Stage, values: Floats) -> Floats:
    return np.asarray(cv2.GaussianBlur(stage.on_grid(values), (0, 0), SIDE / stage.factor))
