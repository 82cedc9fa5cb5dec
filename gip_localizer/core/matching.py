# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 3: map window and bird's-eye view → score of every candidate (x, y, yaw).

The weighted norm (paper, OptimalClassifier; `scoring`) is a few correlations over translations
for each yaw (`correlation`).

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import View
from gip_localizer.core.correlation import correlate
from gip_localizer.core.footprints import Grid
from gip_localizer.core.lattice import (
    Lattice,
    make_canvas,
    make_lattice,
    map_window,
    rotated,
    turn_affine,
    turn_into,
    widened,
)
from gip_localizer.core.levels import locally_centred
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.core.scoring import Residuals, Scorer

__all__ = ['Lattice', 'Scores', 'make_lattice', 'match', 'rotated']

Keep = Callable[[int, Residuals], None]
"""Takes the index of a yaw and its residuals (x, y), valid during the call only."""


@dataclass(frozen=True, eq=False)
class Scores:
    """
    The score surface.

    Attributes
    ----------
    lattice : Lattice
        The candidates.
    residual : (yaws, x, y) float32
        Weighted mean square of v - û (gain and offset profiled out when normalized), in grey
        levels squared; inf where the overlap is too small. The least is the best.
    correlation : (yaws, x, y) float32
        Weighted correlation coefficient of view and map, 0 where undefined.
    overlap : (yaws, x, y) float32
        Share of the view's weight that lies on known map cells.

    """

    lattice: Lattice
    residual: Floats
    correlation: Floats
    overlap: Floats

    def best(self) -> tuple[int, int, int]:
        """Index of the best candidate."""
        index = np.unravel_index(int(np.argmin(self.residual)), self.residual.shape)
        return int(index[0]), int(index[1]), int(index[2])


def match(
    view: View, weight: Floats, raster_map: RasterMap, lattice: Lattice, *,
    normalized: bool, min_overlap: float, centred: bool = False,
) -> Scores:
    """
    Score every candidate of the lattice.

    Parameters
    ----------
    view : View
        Bird's-eye view; its grid's resolution is the lattice's step.
    weight : (rows, cols) float32
        The Gramian's diagonal; 0 for cells without weight.
    raster_map : RasterMap
        The map, or a crop of it that covers the window.
    lattice : Lattice
        The candidates.
    normalized : bool
        True: gain and offset are profiled out.
    min_overlap : float
        Least share of the weight on known map cells, 0..1.
    centred : bool
        True: local means are taken out of view and map, and outliers clipped, first.

    Returns
    -------
    Scores
        Residual, correlation and overlap of every candidate.

    """
    canvas = make_canvas(view.grid, lattice)
    window, known = map_window(raster_map, widened(canvas, lattice), lattice.anchor)
    values = view.patch
    if centred:
        values = locally_centred(values, weight, view.grid.resolution)
        window = locally_centred(window, known, view.grid.resolution)
    scorer = Scorer(values, weight, window, known, normalized=normalized, min_overlap=min_overlap)
    planes = [np.empty(lattice.shape, np.float32) for _ in range(3)]

    def keep(yaw: int, found: Residuals) -> None:
        assert found.correlation is not None
        planes[0][yaw], planes[1][yaw] = found.residual, found.correlation
        planes[2][yaw] = found.overlap

    score_yaws(scorer, view.grid, canvas, lattice, keep)
    return Scores(lattice, *planes)


def score_yaws(
    scorer: Scorer, grid: Grid, canvas: Grid, lattice: Lattice, keep: Keep
) -> None:
    """Give the residuals (x, y) of every yaw to `keep`, from several threads, in any order."""
    sums: dict[int, tuple[float, float]] = {}

    def turn(yaw: int, out: Floats) -> None:
        affine = turn_affine(grid, canvas, float(lattice.yaws[yaw]), lattice.pivot)
        for plane, template in zip(out, scorer.templates, strict=False):
            turn_into(plane, template, affine)
        sums[yaw] = scorer.turned_sums(out)

    correlate(
        scorer.fields, scorer.terms, len(lattice.yaws), canvas=canvas.shape, turn=turn,
        sink=lambda yaw, terms: keep(yaw, scorer.score(terms, sums[yaw])),
    )
