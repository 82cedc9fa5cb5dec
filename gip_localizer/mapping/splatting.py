# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A bird's-eye view drawn onto the cells of a map: every view cell spread over those it covers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.pose import Pose2
from gip_localizer.mapping.tiles import Box

COVERED = 0.6  # least share of a map cell that a view must cover; turned squares miss some of it


class Drawn(NamedTuple):
    """
    What one frame says of map cells.

    Attributes
    ----------
    box : Box
        Where.
    weight : (rows, cols) float64
        Sum of the weights of the view cells on each map cell, row 0 at the least y; 0 where the
        view does not cover it.
    layers : (k, rows, cols) float64
        Weighted means of what was drawn.

    """

    box: Box
    weight: Floats
    layers: Floats


def draw(
    layers: Sequence[Floats], weight: Floats, grid: Grid, T_map_base: Pose2, resolution: float
) -> Drawn:
    """
    Draw what a view tells at its pose.

    A view cell counts as a square along the map's axes, and each map cell takes the share that
    lies on it: edges widen by a view cell at most, and nothing is drawn to one side, whatever
    the phase of the two grids.

    Parameters
    ----------
    layers : k of (rows, cols) float32 or float64
        Numbers of the view's cells.
    weight : (rows, cols) float32
        Weight of each view cell; 0: not looked at.
    grid : Grid
        The view's cells in base, no larger than the map's; better half of it.
    T_map_base : Pose2
        Pose of the vehicle.
    resolution : float
        Side of a map cell, metres.

    """
    seen = (weight > 0.0).ravel()
    if not seen.any():
        return Drawn(Box(0, 0, 0, 0), np.zeros((0, 0)), np.zeros((len(layers), 0, 0)))
    side = grid.resolution / resolution
    low = T_map_base.transform(grid.points()[seen]) / resolution - 0.5 * side
    first = np.floor(low).astype(np.int64)
    over = np.clip(low + side - first - 1.0, 0.0, side) / side  # share on the next cell
    (col, row), (right, up) = first.T, over.T
    box = Box(int(row.min()), int(col.min()), int(np.ptp(row)) + 2, int(np.ptp(col)) + 2)
    start = (row - box.row) * box.cols + (col - box.col)
    cells = np.concatenate([start, start + 1, start + box.cols, start + box.cols + 1])
    shares = np.concatenate([(1.0 - up) * (1.0 - right), (1.0 - up) * right,
                             up * (1.0 - right), up * right])

    def summed(part: Floats) -> Floats:
        sums = np.bincount(cells, shares * np.tile(part, 4), box.rows * box.cols)
        return np.asarray(sums.reshape(box.rows, box.cols))

    each = weight.ravel()[seen].astype(np.float64)
    weights = summed(each)
    weights[summed(np.full(len(each), side**2)) < COVERED] = 0.0
    inverse = np.divide(1.0, weights, out=np.zeros_like(weights), where=weights > 0.0)
    means = [summed(each * layer.ravel()[seen]) * inverse for layer in layers]
    return Drawn(box, weights, np.stack(means))
