# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The compiled loops of this folder: the only file with their addresses and signatures.

There is one function or class per loop. They raise ValueError if the shape or type of an array is
not what the loop reads (`array_checks`). The installation builds the loops if there is a compiler.
Without them (`AVAILABLE` is False, or GIP_COMPILED=0 in the environment) the callers use NumPy,
SciPy and OpenCV, which take longer and round differently in the last bits. ctypes releases
Python's lock during a call.

"""

from __future__ import annotations

from collections.abc import Sequence
import ctypes
import os
from pathlib import Path
import sysconfig

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.kernels.array_checks import (
    check_averaging,
    check_footprints,
    check_pair_fits,
    check_pairs,
    check_translations,
    require_contiguous,
    require_rows,
    require_shape,
)

# Version (no unit) of the functions, as in version.c.
VERSION = 1
# Number of pixels that `footprint_means` reads at once, as in footprints.c.
BLOCK = 16
# Number of zeros that `turn_little` may read on every side of a plane: LANES + 2 of turn.c.
MARGIN = 10
# Largest slope (rows per column) of `turn_little`: LANES - 1 columns of turn.c lie on two rows.
MOST_SLOPE = 1.0 / 7.0
_SIZE, _ADDRESS = ctypes.c_ssize_t, ctypes.c_void_p
_Nothing = ctypes.c_char * 0


class _Planes(ctypes.Structure):
    """Address of (n, rows, cols) float32, and floats from plane to plane and from row to row."""

    _fields_ = (('first', _ADDRESS), ('plane_step', _SIZE), ('row_step', _SIZE))


class _Compared(ctypes.Structure):
    """What of a view is compared with what of a map window, as compare.c says."""

    _fields_ = (
        ('templates', _Planes), ('count', _SIZE), ('rows', _SIZE), ('cols', _SIZE),
        ('fields', _Planes), ('pairs', _ADDRESS), ('pairs_of_term', _ADDRESS), ('terms', _SIZE),
        ('totals', _SIZE),
    )


def load() -> ctypes.CDLL | None:
    path = Path(__file__).with_name(f'_kernels{sysconfig.get_config_var("EXT_SUFFIX")}')
    if os.environ.get('GIP_COMPILED') == '0' or not path.exists():
        return None
    try:
        library = ctypes.CDLL(str(path))
        built = ctypes.c_int.in_dll(library, 'kernels_version').value
    except (OSError, ValueError):  # built for another machine
        return None
    if built != VERSION:
        return None
    planes = ctypes.POINTER(_Planes)
    arguments = {
        'footprint_means': [_ADDRESS, _SIZE, *[_ADDRESS] * 7],
        'compare_turned': [ctypes.POINTER(_Compared), _SIZE, _ADDRESS, _ADDRESS, planes, _SIZE,
                           _SIZE, _ADDRESS, *[_SIZE] * 4, _ADDRESS],
        'pair_planes': [planes, _SIZE, _SIZE, _ADDRESS, _SIZE],
        'sum_complex_products': [_ADDRESS, _ADDRESS, _SIZE, _SIZE, _ADDRESS],
        'turn_little': [planes, _SIZE, _SIZE, _ADDRESS, planes, *[_SIZE] * 3],
        'join_cells': [_ADDRESS, *[_SIZE] * 5, _ADDRESS, *[_SIZE] * 2, ctypes.c_int, _ADDRESS,
                       _ADDRESS, _SIZE, _SIZE],
    }
    for name, kinds in arguments.items():
        function = getattr(library, name)
        function.argtypes, function.restype = kinds, None
    return library


_LIBRARY = load()
# Whether the compiled loops are built and not disabled.
AVAILABLE = _LIBRARY is not None


class PlaneArray:
    """
    Planes as the loops take them; it keeps the array alive.

    Parameters
    ----------
    planes : (n, rows, cols) float32
        There may be gaps between planes and rows, but not within a row.

    """

    def __init__(self, planes: Floats) -> None:
        first = _row_address('planes', planes, np.float32, 3)
        plane, row, cell = planes.strides
        self.array = planes
        self.c = _Planes(first, plane // cell, row // cell)


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
        self._c = _Compared(
            templates.c, count, rows, cols, fields.c, _address('pairs', pairs, np.int32),
            _address('pairs_of_term', pairs_of_term, np.int32), self._terms, totals,
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
        _kernels().compare_turned(
            self._c, yaws, _address('affines', affines, np.float64),
            _address('turned', turned, np.uint8),
            (_Planes * yaws)(*(buffer.c for buffer in buffers)), *shape[1:],
            _address('totals', totals, np.float32), x, y, n_x, n_y,
            _address('sums', sums, np.float32),
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
    _kernels().turn_little(
        planes.c, *planes.array.shape[1:], _address('affine', affine, np.float64), target.c,
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
    first = _row_address('image', image, np.uint8, 2)
    check_footprints(image, starts, cells, len(means), block=BLOCK)
    _kernels().footprint_means(
        first, len(cells_of_group), _address('cells_of_group', cells_of_group, np.int32),
        _address('blocks_per_cell', blocks_per_cell, np.int32),
        _address('starts', starts, np.int32), _address('weights', weights, np.uint8),
        _address('cells', cells, np.int32), _address('factors', factors, np.float32),
        _address('means', means, np.float32),
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
    first = _row_address('values', values, np.float32, 2)
    require_shape('taps', taps.shape, taps.shape[:1])
    check_averaging(values.shape, len(taps), factor, shape)
    out = np.empty(shape, np.float32)
    buffer = np.empty(2 * (factor * (shape[1] - 1) + len(taps)), np.float32)
    _kernels().join_cells(
        first, values.strides[0] // values.itemsize, *values.shape, *corner,
        _address('taps', taps, np.float32), len(taps), factor, replicate,
        _address('buffer', buffer, np.float32), _address('out', out, np.float32), *shape,
    )
    return out


def pair_planes(pair: Floats, plane: Grey) -> None:
    """Write real planes (2, rows, cols) float32 into the first corner of a complex64 plane."""
    source = PlaneArray(pair)
    require_shape('pair', pair.shape, (2, *pair.shape[1:]))
    _, rows, cols = pair.shape
    check_pair_fits(pair.shape, plane.shape)
    _kernels().pair_planes(
        source.c, rows, cols, _address('plane', plane, np.complex64), 2 * plane.shape[1]
    )


def sum_complex_products(pairs: Sequence[tuple[Grey, Grey]], out: Grey) -> None:
    """Write the sum of products of complex64 arrays of one shape; `out` may be one of them."""
    for array in (array for pair in pairs for array in pair):
        require_shape('factor', array.shape, out.shape)
    left, right = (
        (_ADDRESS * len(pairs))(*(_address('factor', array, np.complex64) for array in arrays))
        for arrays in zip(*pairs, strict=True)
    )
    _kernels().sum_complex_products(
        left, right, len(pairs), out.size, _address('out', out, np.complex64)
    )


def _kernels() -> ctypes.CDLL:
    """Return the library, which is `AVAILABLE`."""
    if _LIBRARY is None:
        raise RuntimeError('the compiled loops are not available; ask AVAILABLE first')
    return _LIBRARY


def _address(name: str, array: Grey, kind: type) -> int:
    """Return the address of an array without gaps."""
    require_contiguous(name, array, kind)
    if array.flags.writeable:  # a third of the time
        return ctypes.addressof(_Nothing.from_buffer(array.data))
    return array.ctypes.data


def _row_address(name: str, array: Grey, kind: type, axes: int) -> int:
    """Return the address of an array whose rows have no gaps."""
    require_rows(name, array, kind, axes)
    return array.ctypes.data
