# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The baseline, `peer` in result files: OpenCV's masked template matching, once per yaw."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.match.lattice import rotated
from gip_localizer.core.match.pyramid.level import Level

NAME = 'cv2.matchTemplate(TM_SQDIFF, mask)'


def baseline_work(level: Level, yaws: int) -> Callable[[], object]:
    """
    Return the work of the baseline for a number of yaws.

    It matches the unrotated view with map windows that are assumed to be rotated already: the
    least work for OpenCV. Rotation and the choice of the best candidate are not included.

    """
    half, grid = level.lattice.half, level.grid
    rows, cols = grid.rows + 2 * half[0], grid.cols + 2 * half[1]
    window = np.ascontiguousarray(level.window[:rows, :cols])
    mask = np.sqrt(level.weight)

    def work() -> None:
        for _ in range(yaws):
            cv2.matchTemplate(window, level.values, cv2.TM_SQDIFF, mask=mask)

    return work


def baseline_winner(level: Level) -> tuple[int, int, int]:
    """Return the index of OpenCV's best candidate on the lattice."""
    weight, values = level.weight, level.values
    mean = np.float32(np.average(values, weights=weight))
    planes = np.dstack([weight, weight * (values - mean), weight * (values - mean) ** 2])
    window = level.window - mean
    best, winner = np.inf, (0, 0, 0)
    for k, yaw in enumerate(level.lattice.yaws):
        turned = rotated(planes, level.grid, level.canvas, float(yaw), pivot=level.lattice.pivot)
        surface = _surface(turned, window, float(planes[..., 2].sum(dtype=np.float64)))
        place = int(surface.argmin())
        if surface.flat[place] < best:
            best = float(surface.flat[place])
            x, y = divmod(place, level.lattice.shape[2])
            winner = k, x, y
    return winner


def _surface(turned: Floats, window: Floats, total_vv: float) -> Floats:
    """Return the weighted mean squares of one yaw (x, y) from the sums of OpenCV."""
    G, Gv = np.maximum(turned[..., 0], 0.0), turned[..., 1]
    view = np.divide(Gv, G, out=np.zeros_like(G), where=G > 0.0)
    sums = cv2.matchTemplate(window, view, cv2.TM_SQDIFF, mask=np.sqrt(G))
    missing = total_vv - float((Gv * view).sum(dtype=np.float64))
    return np.asarray((sums.astype(np.float64) + missing) / G.sum(dtype=np.float64))
