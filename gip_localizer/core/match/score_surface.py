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
from itertools import pairwise
import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.kernels.binding import AVAILABLE, PlaneArray
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.compiled_scores import Comparison
from gip_localizer.core.match.correlation import correlate
from gip_localizer.core.match.downsampling import locally_centred
from gip_localizer.core.match.fft import cost
from gip_localizer.core.match.fft_regions import make_parts, Part
from gip_localizer.core.match.lattice import (
    Lattice,
    make_canvas,
    make_lattice,
    map_window,
    rotated,
    widened,
)
from gip_localizer.core.match.scoring import Residuals, Scorer
from gip_localizer.core.match.template_rotation import turn_affine
from gip_localizer.core.threads import in_parallel, WORKERS

__all__ = ['Lattice', 'Scores', 'make_lattice', 'match', 'rotated']

# Largest number of translations for which the compiled loops are used (measured: with more,
# Fourier transforms are faster).
MOST_BY_LOOPS = 200
# Least number of products for which threads are used (design choice: 5,000,000, because with fewer
# the threads wait longer than they work).
MIN_FOR_THREADS = 5_000_000
Keep = Callable[[slice, Residuals], None]
"""Takes yaws (indices) and their residuals (yaws, x, y), valid during the call only."""


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

    def keep(yaws: slice, found: Residuals) -> None:
        assert found.correlation is not None
        planes[0][yaws], planes[1][yaws] = found.residual, found.correlation
        planes[2][yaws] = found.overlap

    score_yaws(scorer, view.grid, canvas, lattice, keep)
    return Scores(lattice, *planes)


def score_yaws(
    scorer: Scorer, grid: Grid, canvas: Grid, lattice: Lattice, keep: Keep
) -> None:
    """Give the residuals (yaws, x, y) of all yaws to `keep`, in any order, from threads."""
    affines = [turn_affine(grid, canvas, float(yaw), lattice.pivot) for yaw in lattice.yaws]
    n_x, n_y = lattice.shape[1:]
    if AVAILABLE and n_x * n_y <= MOST_BY_LOOPS:
        _score_by_loops(scorer, affines, canvas.shape, keep)
        return
    parts = make_parts(
        scorer.templates.planes[0], affines, canvas.shape, (n_x, n_y), len(scorer.fields), cost
    )
    for part in parts:
        rows, cols = part.rows, part.cols
        window = slice(rows.start, rows.stop + n_x - 1), slice(cols.start, cols.stop + n_y - 1)
        chosen = affines[part.yaws.start : part.yaws.stop]
        if rows.start or cols.start:
            chosen = [_moved(affine, rows.start, cols.start) for affine in chosen]
        _score_part(scorer, scorer.fields[:, window[0], window[1]], chosen, part, keep)


def _moved(affine: Floats, row: int, col: int) -> Floats:
    """Return the map from a part of the canvas that begins at a row and a column."""
    return np.hstack([affine[:, :2], affine[:, 2:] + affine[:, :2] @ [[col], [row]]])


def _score_by_loops(scorer: Scorer, affines: list[Floats], canvas: tuple[int, int],
                    keep: Keep) -> None:
    """Score few translations of all yaws with the compiled loops."""
    size = tuple(1 + n - k for n, k in zip(scorer.fields.shape[1:], canvas, strict=True))
    comparison = Comparison(scorer.templates, scorer.fields, scorer.terms, scorer.sums_needed)

    def work(yaws: slice) -> None:
        buffer = PlaneArray(np.empty((len(scorer.templates.planes), *canvas), np.float32))
        sums, turned = comparison.sums_in(buffer, affines[yaws], size)
        keep(yaws, scorer.score(sums, turned[:, :, None, None]))

    count = len(affines)
    products = count * math.prod(size) * math.prod(canvas)
    parts = WORKERS if products >= MIN_FOR_THREADS else 1
    cuts = np.linspace(0, count, min(parts, count) + 1).astype(int).tolist()
    in_parallel(work, [slice(a, b) for a, b in pairwise(cuts)])


def _score_part(
    scorer: Scorer, fields: Floats, affines: list[Floats], part: Part, keep: Keep
) -> None:
    sums = np.empty((len(affines), scorer.sums_needed), np.float32)

    def turn(yaw: int, out: Floats) -> None:
        sums[yaw] = scorer.templates.turned(out, affines[yaw], scorer.sums_needed)

    def sink(yaws: range, terms: Floats) -> None:
        first = part.yaws.start
        found = scorer.score(terms, sums[yaws.start : yaws.stop, :, None, None])
        keep(slice(first + yaws.start, first + yaws.stop), found)

    correlate(fields, scorer.terms, len(affines), canvas=part.shape, turn=turn, sink=sink)
