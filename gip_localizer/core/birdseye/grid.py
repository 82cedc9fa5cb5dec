# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The grid of the bird's-eye view: cells of the road ahead, in the base frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gip_localizer.core.arrays import Floats


@dataclass(frozen=True)
class Grid:
    """
    The cells of the bird's-eye view in the base frame.

    Row 0 is the farthest (largest x) and column 0 the leftmost (largest y), as seen from above
    with the vehicle driving up.

    Attributes
    ----------
    far, left : float
        The x of the far edge and the y of the left edge, metres.
    rows, cols : int
        Cells along x and along y.
    resolution : float
        Side of a cell, metres.

    """

    far: float
    left: float
    rows: int
    cols: int
    resolution: float

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows, self.cols

    def points(self, offset: float = 0.5) -> Floats:
        """Points (rows * cols, 2) of the cells in base; offset 0.5 is the centre."""
        x = self.far - (np.arange(self.rows) + offset) * self.resolution
        y = self.left - (np.arange(self.cols) + offset) * self.resolution
        return np.stack(np.meshgrid(x, y, indexing='ij'), axis=-1).reshape(-1, 2)

    def corners(self) -> Floats:
        """Corner lattice ((rows + 1) * (cols + 1), 2) in base, metres."""
        return Grid(self.far, self.left, self.rows + 1, self.cols + 1, self.resolution).points(0.0)

    def outline(self) -> Floats:
        """Outermost corners (4, 2) in base, metres."""
        near = self.far - self.rows * self.resolution
        right = self.left - self.cols * self.resolution
        return np.array([[x, y] for x in (self.far, near) for y in (self.left, right)])

    def cell_of(self, xy: Floats) -> tuple[Floats, Floats]:
        """Fractional row and column of base points (..., 2); a cell is [k, k + 1)."""
        return (self.far - xy[..., 0]) / self.resolution, (self.left - xy[..., 1]) / (
            self.resolution
        )
