# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Addresses and signatures of the compiled loops: the only file that opens their library.

The installation builds the loops if there is a compiler. ctypes releases Python's lock during a
call.

"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
import sysconfig

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.kernels.array_checks import require_contiguous, require_rows

# Version (no unit) of the functions, as in version.c.
VERSION = 1
SIZE, ADDRESS = ctypes.c_ssize_t, ctypes.c_void_p
_Nothing = ctypes.c_char * 0


class Planes(ctypes.Structure):
    """Address of (n, rows, cols) float32, and floats from plane to plane and from row to row."""

    _fields_ = (('first', ADDRESS), ('plane_step', SIZE), ('row_step', SIZE))


class Compared(ctypes.Structure):
    """The parts of a view and of a map window that are compared, as in compare.c."""

    _fields_ = (
        ('templates', Planes), ('count', SIZE), ('rows', SIZE), ('cols', SIZE),
        ('fields', Planes), ('pairs', ADDRESS), ('pairs_of_term', ADDRESS), ('terms', SIZE),
        ('totals', SIZE),
    )


def load() -> ctypes.CDLL | None:
    """Return the library; None if it is disabled, missing, or built for another machine."""
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
    planes = ctypes.POINTER(Planes)
    arguments = {
        'footprint_means': [ADDRESS, SIZE, *[ADDRESS] * 7],
        'compare_turned': [ctypes.POINTER(Compared), SIZE, ADDRESS, ADDRESS, planes, SIZE,
                           SIZE, ADDRESS, *[SIZE] * 4, ADDRESS],
        'pair_planes': [planes, SIZE, SIZE, ADDRESS, SIZE],
        'sum_complex_products': [ADDRESS, ADDRESS, SIZE, SIZE, ADDRESS],
        'turn_little': [planes, SIZE, SIZE, ADDRESS, planes, *[SIZE] * 3],
        'join_cells': [ADDRESS, *[SIZE] * 5, ADDRESS, *[SIZE] * 2, ctypes.c_int, ADDRESS,
                       ADDRESS, SIZE, SIZE],
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
        first = row_address('planes', planes, np.float32, 3)
        plane, row, cell = planes.strides
        self.array = planes
        self.c = Planes(first, plane // cell, row // cell)


def loaded_library() -> ctypes.CDLL:
    """Return the library, which is `AVAILABLE`."""
    if _LIBRARY is None:
        raise RuntimeError('the compiled loops are not available; check AVAILABLE first')
    return _LIBRARY


def address(name: str, array: Grey, kind: type) -> int:
    """Return the address of an array without gaps."""
    require_contiguous(name, array, kind)
    if array.flags.writeable:  # three times as fast as the next line
        return ctypes.addressof(_Nothing.from_buffer(array.data))
    return array.ctypes.data


def row_address(name: str, array: Grey, kind: type, axes: int) -> int:
    """Return the address of an array whose rows have no gaps."""
    require_rows(name, array, kind, axes)
    return array.ctypes.data
