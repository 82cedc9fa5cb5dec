# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The loops of this folder, where a C compiler built them: the one file that knows their signatures.

One function or class per loop. They take arrays, and raise ValueError where an array's shape or
type is not what the loop reads. Installing builds the loops if it can. Without them (`AVAILABLE`
is False; or with GIP_COMPILED=0 in the environment) the callers do the same work with NumPy, SciPy
and OpenCV, which takes longer and rounds otherwise in the last bits. ctypes releases Python's lock
during a call.

"""

from __future__ import annotations

from collections.abc import Sequence
import ctypes
import os
from pathlib import Path
import sysconfig

import numpy as np

from gip_localizer.core.arrays import Floats, Grey

VERSION = 1  # of the functions, as in version.c
BLOCK = 16  # pixels that `footprint_means` reads at once, as in footprints.c
MARGIN = 10  # zeros that `turn_little` may read on every side of a plane, LANES + 2 of turn.c
MOST_SLOPE = 1.0 / 7.0  # rows per column up to which `turn_little` turns: LANES - 1 on two rows
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
AVAILABLE = _LIBRARY is not None


class PlaneArray:
    """
    Planes as the loops take them; it keeps the array alive.

    Parameters
    ----------
    planes : (n, rows, cols) float32
        Planes and rows may be apart, the elements of a row not.

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
        _require('pairs', pairs.shape, (int(pairs_of_term.sum()), 2))
        there = bool((pairs >= 0).all() and (pairs < (count, len(fields.array))).all())
        if not there or not 0 <= totals <= count:
            raise ValueError(f'pairs {pairs.tolist()} or {totals} totals are beyond {count} '
                             f'templates and {len(fields.array)} fields')
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
            _require('buffer', buffer.array.shape, (len(templates.array), *shape[1:]))
        _require('affines', affines.shape, (yaws, 2, 3))
        _require('turned', turned.shape, (yaws,))
        _require('totals', totals.shape, (yaws, self._totals))
        _require('sums', sums.shape, (yaws, self._terms, *sums.shape[2:]))
        (x, y), (n_x, n_y) = start, sums.shape[2:]
        _, rows, cols = fields.array.shape
        if not (0 <= x <= rows - shape[1] - n_x + 1 and 0 <= y <= cols - shape[2] - n_y + 1):
            raise ValueError(f'{n_x} x {n_y} translations from {start} on move templates of '
                             f'{shape[1:]} out of fields of {(rows, cols)}')
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
    _require('affine', affine.shape, (2, 3))
    _require('out', out.shape, (len(planes.array), *out.shape[1:]))
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
    _require('blocks_per_cell', blocks_per_cell.shape, cells_of_group.shape)
    _require('cells', cells.shape, (int(cells_of_group.sum()),))
    _require('starts', starts.shape, (int(cells_of_group @ blocks_per_cell),))
    _require('weights', weights.shape, (len(starts), BLOCK))
    _require('factors', factors.shape, cells.shape)
    _require('means', means.shape, cells.shape)
    first = _row_address('image', image, np.uint8, 2)
    extent = (image.shape[0] - 1) * image.strides[0] + image.shape[1]
    if starts.size and not (starts.min() >= 0 and starts.max() + BLOCK <= extent):
        raise ValueError(f'blocks of {BLOCK} bytes begin at {starts.min()} to {starts.max()}, '
                         f'the image has {extent} bytes')
    if cells.size and not (cells.min() >= 0 and cells.max() < len(means)):
        raise ValueError(f'cells {cells.min()} to {cells.max()} of {len(means)} means')
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
        What lies beyond the values: True: is like their edge; False: is 0.

    Returns
    -------
    (rows, cols) float32
        A new array.

    """
    first = _row_address('values', values, np.float32, 2)
    _require('taps', taps.shape, taps.shape[:1])
    if min(*shape, *values.shape, factor, len(taps)) < 1:
        raise ValueError(f'cells of shape {values.shape}, {len(taps)} taps, factor {factor} and '
                         f'larger cells of shape {shape}: all must be at least 1')
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
    _require('pair', pair.shape, (2, *pair.shape[1:]))
    _, rows, cols = pair.shape
    if plane.ndim != 2 or rows > plane.shape[0] or cols > plane.shape[1]:
        raise ValueError(f'planes of shape {pair.shape} do not fit into one of {plane.shape}')
    _kernels().pair_planes(
        source.c, rows, cols, _address('plane', plane, np.complex64), 2 * plane.shape[1]
    )


def sum_complex_products(pairs: Sequence[tuple[Grey, Grey]], out: Grey) -> None:
    """Write the sum of products of complex64 arrays of one shape; `out` may be one of them."""
    for array in (array for pair in pairs for array in pair):
        _require('factor', array.shape, out.shape)
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


def _require(name: str, found: tuple[int, ...], expected: tuple[int, ...]) -> None:
    if found != expected:
        raise ValueError(f'{name} has shape {found}; the loop expects {expected}')


def _address(name: str, array: Grey, kind: type) -> int:
    """Return the address of an array without gaps."""
    if array.dtype != kind or not array.flags.c_contiguous:
        raise ValueError(f'{name} is {array.dtype} with strides {array.strides}; the loop expects '
                         f'{np.dtype(kind)} without gaps')
    if array.flags.writeable:  # a third of the time
        return ctypes.addressof(_Nothing.from_buffer(array.data))
    return array.ctypes.data


def _row_address(name: str, array: Grey, kind: type, axes: int) -> int:
    """Return the address of an array whose rows have no gaps."""
    gaps = array.size > 0 and array.strides[-1] != array.itemsize
    if array.dtype != kind or array.ndim != axes or gaps:
        raise ValueError(f'{name} is {array.dtype} of shape {array.shape}, strides '
                         f'{array.strides}; the loop expects {np.dtype(kind)} with {axes} axes, '
                         'the last without gaps')
    return array.ctypes.data
