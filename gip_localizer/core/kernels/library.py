# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The loops of `kernels/`, where a C compiler built them.

Installing builds them if it can. Without them (`AVAILABLE` is False; or with GIP_COMPILED=0 in
the environment) the callers do the same work with NumPy, SciPy and OpenCV, which takes longer and
rounds otherwise in the last bits. ctypes releases Python's lock during a call.

"""

from __future__ import annotations

import ctypes
import os
from pathlib import Path
import sysconfig

import numpy as np

from gip_localizer.core.arrays import Grey

VERSION = 1  # of the functions, as in kernels/version.c
SIZE, ADDRESS = ctypes.c_ssize_t, ctypes.c_void_p
_Nothing = ctypes.c_char * 0


class Planes(ctypes.Structure):
    """Address of (n, rows, cols) float32, and floats from plane to plane and from row to row."""

    _fields_ = (('first', ADDRESS), ('plane_step', SIZE), ('row_step', SIZE))


class Compared(ctypes.Structure):
    """What of a view is compared with what of a map window, as kernels/compare.c says."""

    _fields_ = (
        ('templates', Planes), ('count', SIZE), ('rows', SIZE), ('cols', SIZE), ('fields', Planes),
        ('pairs', ADDRESS), ('pairs_of_term', ADDRESS), ('terms', SIZE), ('totals', SIZE),
    )


def _load() -> ctypes.CDLL | None:
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
        'compare_turned': [ctypes.POINTER(Compared), SIZE, ADDRESS, ADDRESS, planes, SIZE, SIZE,
                           ADDRESS, *[SIZE] * 4, ADDRESS],
        'pair_planes': [planes, SIZE, SIZE, ADDRESS, SIZE],
        'sum_complex_products': [ADDRESS, ADDRESS, SIZE, SIZE, ADDRESS],
        'turn_little': [planes, SIZE, SIZE, ADDRESS, planes, *[SIZE] * 3],
        'join_cells': [ADDRESS, *[SIZE] * 5, ADDRESS, *[SIZE] * 2, ctypes.c_int, ADDRESS, ADDRESS,
                       SIZE, SIZE],
    }
    for name, kinds in arguments.items():
        function = getattr(library, name)
        function.argtypes, function.restype = kinds, None
    return library


_LIBRARY = _load()
AVAILABLE = _LIBRARY is not None


def kernels() -> ctypes.CDLL:
    """Return the library, which is `AVAILABLE`."""
    assert _LIBRARY is not None
    return _LIBRARY


def address(array: Grey, kind: type) -> int:
    """Return the address of an array without gaps."""
    assert array.flags.c_contiguous
    assert array.dtype == kind
    if array.flags.writeable:  # a third of the time
        return ctypes.addressof(_Nothing.from_buffer(array.data))
    return array.ctypes.data


def row_address(array: Grey, kind: type) -> int:
    """Return the address of an array whose rows have no gaps."""
    assert array.dtype == kind
    assert array.size == 0 or array.strides[-1] == array.itemsize
    return array.ctypes.data


def c_planes(planes: Grey) -> Planes:
    """Return what the loops take of planes (n, rows, cols) float32; it keeps no array alive."""
    plane, row, cell = planes.strides
    return Planes(row_address(planes, np.float32), plane // cell, row // cell)
