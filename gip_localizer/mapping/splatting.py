# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw a bird's-eye view on map cells: each view cell is spread over the cells it covers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.pose import Pose2
from gip_localizer.mapping.tiles import Box

COVERED = 0.6
"""Least fraction of a map cell that a view must cover; chosen, since rotated views leave gaps."""


class Drawn(NamedTuple):
    """
    The values of one frame on map cells.

    Attributes
    ----------
    box : Box
        The cells.
    weight : (rows, cols) float64
        Sum of the weights of the view cells on each map cell, row 0 at the smallest y; 0 where
        the view does not cover the cell.
    layers : (k, rows, cols) float64
        Weighted means of the drawn layers.

    """

    box: Box
    weight: Floats
    layers: Floats


def draw(
    layers: Sequence[Floats], weight: Floats, grid: Grid, T_map_base: Pose2, resolution: float
) -> Drawn:
    """
    Draw the layers of a view at its pose.

    A view cell counts as a square along the map's axes, and each map cell receives the part that
    lies on it. Edges are blurred by at most one view cell, and nothing is shifted to one side,
    for any offset of the two grids.

    Parameters
    ----------
    layers : k of (rows, cols) float32 or float64
        Values of the view's cells.
    weight : (rows, cols) float32
        Weight of each view cell; 0 excludes it.
    grid : Grid
        The view's cells in the base frame, not larger than the map's; best half their size.
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
    over = np.clip(low + side - first - 1.0, 0.0, side) / side  # fraction on the next cell
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
