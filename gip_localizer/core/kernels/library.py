# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The compiled loops of this folder: one function or class per loop.

They raise ValueError if the shape or type of an array is not what the loop reads
(`array_checks`). Without the loops (`AVAILABLE` is False, or GIP_COMPILED=0 in the environment)
the callers use NumPy, SciPy and OpenCV, which take longer and round differently in the last bits.
`binding` holds their addresses and signatures.

"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.kernels.array_checks import (
    check_averaging,
    check_footprints,
    check_pair_fits,
    check_pairs,
    check_translations,
    require_shape,
)
from gip_localizer.core.kernels.binding import (
    ADDRESS,
    address,
    Compared,
    loaded_library,
    PlaneArray,
    Planes,
    row_address,
)

# Number of pixels that `footprint_means` reads at once, as in footprints.c.
BLOCK = 16
# Number of zeros that `turn_little` may read on every side of a plane: LANES + 2 of turn.c.
MARGIN = 10
# Largest slope (rows per column) of `turn_little`: LANES - 1 columns of turn.c lie on two rows.
MOST_SLOPE = 1.0 / 7.0
class TurnedComparison:
    """
    Sums of products of turned templates and fields over few translations (compare.c).

    Parameters
    ----------
    templates : PlaneArray
        (n, rows, cols), with `MARGIN` zeros around each.
    fields : PlaneArray
        (n_fields, map rows, map cols).
    pairs : (n_pairs, 2) int32
        Template and field of each pair, term by term.
    pairs_of_term : (terms,) int32
        How many pairs each term has.
    totals : int
        Of how many templates, the first ones, the sums are wanted.

    """

    def __init__(
        self, templates: PlaneArray, fields: PlaneArray, pairs: Grey, pairs_of_term: Grey,
        totals: int,
    ) -> None:
        self._kept = templates, fields, pairs, pairs_of_term
        self._terms, self._totals = len(pairs_of_term), totals
        count, rows, cols = templates.array.shape
        require_shape('pairs', pairs.shape, (int(pairs_of_term.sum()), 2))
        check_pairs(pairs, count, len(fields.array), totals)
        self._c = Compared(
            templates.c, count, rows, cols, fields.c, address('pairs', pairs, np.int32),
            address('pairs_of_term', pairs_of_term, np.int32), self._terms, totals,
        )

    def __call__(
        self, affines: Floats, turned: Grey, buffers: Sequence[PlaneArray], totals: Floats,
        start: tuple[int, int], sums: Floats,
    ) -> None:
        """
        Turn the templates of each yaw, if they are not turned, and sum up its terms.

        Parameters
        ----------
        affines : (yaws, 2, 3) float64
            From columns and rows of a buffer to those of the templates.
        turned : (yaws,) uint8
            Whether a buffer holds the turned templates.
        buffers : sequence of PlaneArray
            (n, rows, cols) of each yaw, all of one shape.
        totals : (yaws, totals) float32
            Sums of the turned templates; written for yaws that are turned here.
        start : (int, int)
            The first translation in rows and columns.
        sums : (yaws, terms, n_x, n_y) float32
            Written.

        """
        templates, fields = self._kept[:2]
        yaws, shape = len(buffers), buffers[0].array.shape
        for buffer in buffers:
            require_shape('buffer', buffer.array.shape, (len(templates.array), *shape[1:]))
        require_shape('affines', affines.shape, (yaws, 2, 3))
        require_shape('turned', turned.shape, (yaws,))
        require_shape('totals', totals.shape, (yaws, self._totals))
        require_shape('sums', sums.shape, (yaws, self._terms, *sums.shape[2:]))
        (x, y), (n_x, n_y) = start, sums.shape[2:]
        check_translations(start, (n_x, n_y), shape[1:], fields.array.shape[1:])
        loaded_library().compare_turned(
            self._c, yaws, address('affines', affines, np.float64),
            address('turned', turned, np.uint8),
            (Planes * yaws)(*(buffer.c for buffer in buffers)), *shape[1:],
            address('totals', totals, np.float32), x, y, n_x, n_y,
            address('sums', sums, np.float32),
        )


def turn_little(planes: PlaneArray, affine: Floats, out: Floats) -> None:
    """
    Turn planes by little, bilinear (turn.c).

    Parameters
    ----------
    planes : PlaneArray
        (n, rows, cols), with `MARGIN` zeros around each.
    affine : (2, 3) float64
        From columns and rows of `out` to those of the planes; a slope of `MOST_SLOPE` at most.
    out : (n, out rows, out cols) float32
        Written.

    """
    target = PlaneArray(out)
    require_shape('affine', affine.shape, (2, 3))
    require_shape('out', out.shape, (len(planes.array), *out.shape[1:]))
    loaded_library().turn_little(
        planes.c, *planes.array.shape[1:], address('affine', affine, np.float64), target.c,
        *out.shape,
    )


def footprint_means(
    image: Grey, starts: Grey, weights: Grey, groups: tuple[Grey, Grey], cells: Grey,
    factors: Floats, means: Floats,
) -> None:
    """
    Average bytes over footprints (footprints.c).

    Parameters
    ----------
    image : (rows, cols) uint8
        Rows without gaps.
    starts : (blocks,) int32
        Bytes from the image's first pixel to each block of `BLOCK` pixels.
    weights : (blocks, BLOCK) uint8
        Of the pixels, at most 64.
    groups : ((n,) int32, (n,) int32)
        Cells of each group, and blocks per cell in it.
    cells : (n_cells,) int32
        Where in `means` each cell goes.
    factors : (n_cells,) float32
        What the sums of each cell are multiplied by.
    means : (n_cells,) float32
        Written.

    """
    cells_of_group, blocks_per_cell = groups
    require_shape('blocks_per_cell', blocks_per_cell.shape, cells_of_group.shape)
    require_shape('cells', cells.shape, (int(cells_of_group.sum()),))
    require_shape('starts', starts.shape, (int(cells_of_group @ blocks_per_cell),))
    require_shape('weights', weights.shape, (len(starts), BLOCK))
    require_shape('factors', factors.shape, cells.shape)
    require_shape('means', means.shape, cells.shape)
    first = row_address('image', image, np.uint8, 2)
    check_footprints(image, starts, cells, len(means), block=BLOCK)
    loaded_library().footprint_means(
        first, len(cells_of_group), address('cells_of_group', cells_of_group, np.int32),
        address('blocks_per_cell', blocks_per_cell, np.int32),
        address('starts', starts, np.int32), address('weights', weights, np.uint8),
        address('cells', cells, np.int32), address('factors', factors, np.float32),
        address('means', means, np.float32),
    )


def average_cells(
    values: Floats, taps: Floats, factor: int, corner: tuple[int, int], shape: tuple[int, int],
    *, replicate: bool,
) -> Floats:
    """
    Average cells into larger ones (join.c).

    Parameters
    ----------
    values : (rows, cols) float32
        Rows without gaps.
    taps : (n,) float32
        Weights of neighbours along either axis.
    factor : int
        Cells from one larger cell to the next.
    corner : (int, int)
        Rows and columns that the first taps lie before the values; negative: behind their first.
    shape : (int, int)
        Rows and columns of the larger cells.
    replicate : bool
        Values outside the array: True: those of its edge; False: 0.

    Returns
    -------
    (rows, cols) float32
        A new array.

    """
    first = row_address('values', values, np.float32, 2)
    require_shape('taps', taps.shape, taps.shape[:1])
    check_averaging(values.shape, len(taps), factor, shape)
    out = np.empty(shape, np.float32)
    buffer = np.empty(2 * (factor * (shape[1] - 1) + len(taps)), np.float32)
    loaded_library().join_cells(
        first, values.strides[0] // values.itemsize, *values.shape, *corner,
        address('taps', taps, np.float32), len(taps), factor, replicate,
        address('buffer', buffer, np.float32), address('out', out, np.float32), *shape,
    )
    return out


def pair_planes(pair: Floats, plane: Grey) -> None:
    """Write real planes (2, rows, cols) float32 into the first corner of a complex64 plane."""
    source = PlaneArray(pair)
    require_shape('pair', pair.shape, (2, *pair.shape[1:]))
    _, rows, cols = pair.shape
    check_pair_fits(pair.shape, plane.shape)
    loaded_library().pair_planes(
        source.c, rows, cols, address('plane', plane, np.complex64), 2 * plane.shape[1]
    )


def sum_complex_products(pairs: Sequence[tuple[Grey, Grey]], out: Grey) -> None:
    """Write the sum of products of complex64 arrays of one shape; `out` may be one of them."""
    for array in (array for pair in pairs for array in pair):
        require_shape('factor', array.shape, out.shape)
    left, right = (
        (ADDRESS * len(pairs))(*(address('factor', array, np.complex64) for array in arrays))
        for arrays in zip(*pairs, strict=True)
    )
    loaded_library().sum_complex_products(
        left, right, len(pairs), out.size, address('out', out, np.complex64)
    )
