# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Two-dimensional transforms of complex planes, by the faster of two libraries.

A plane holds two real ones, as its real and its imaginary part: their correlations with a real
field come out the same way, in less time than two real transforms take. OpenCV with Intel's IPP
takes a third of the time of SciPy's; without IPP, twice the time. The choice depends on OpenCV's
build alone, so that equal inputs give equal bytes.

"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import islice
from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from gip_localizer.core.arrays import Floats
from gip_localizer.core.kernels.binding import AVAILABLE
from gip_localizer.core.kernels.library import pair_planes, sum_complex_products

# Number of sizes of a transform that are compared, and their common factor (design choice: 8 and
# 4, because a fast size is always among them).
SIZES_TRIED, MULTIPLE = 8, 4
ODD_COST = {32: 1.0, 16: 1.08, 8: 1.17, 4: 1.17}
"""Relative time per cell of transforms, by the largest of these factors of the size (design
choice: estimates)."""
Plane = NDArray[np.complex64]


class Transform(Protocol):
    """
    Transforms of planes (rows, cols) complex64, which may be larger than what is put in.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the planes.

    """

    shape: tuple[int, int]

    def forward(self, plane: Plane, rows: int, out: Plane) -> None:
        """Transform a plane of which only the first rows are not zero."""
        ...

    def backward(self, spectrum: Plane, rows: int, out: Plane) -> Plane:
        """Return at least the first rows of the transform of a spectrum, perhaps in `out`."""
        ...


def field_spectrum(transform: Transform, field: Floats) -> Plane:
    """
    Transform a real field, so that a product with a template's spectrum is their correlation's.

    Conjugate and scaled: both transforms go the same way, which turns the indices around twice.

    """
    rows, cols = field.shape
    plane = np.zeros(transform.shape, np.complex64)
    plane.real[:rows, :cols] = field
    out = np.empty_like(plane)
    transform.forward(plane, rows, out)
    np.conjugate(out, out=out)
    out *= np.float32(1.0 / plane.size)
    return out


def put_pair(pair: Floats, plane: Plane) -> None:
    """Write two real planes (2, rows, cols) float32 into the first corner of a complex one."""
    rows, cols = pair.shape[1:]
    if AVAILABLE:
        pair_planes(pair, plane)
    else:
        corner = plane[:rows, :cols]
        corner.real, corner.imag = pair


def add_products(pairs: Sequence[tuple[Plane, Plane]], out: Plane, buffer: Plane) -> None:
    """Write the sum of products of planes; `out` may be one of the first pair, `buffer` none."""
    if AVAILABLE:
        sum_complex_products(pairs, out)
        return
    (field, spectrum), *others = pairs
    np.multiply(field, spectrum, out=out)
    for field, spectrum in others:
        out += np.multiply(field, spectrum, out=buffer)


def cost(rows: int, cols: int) -> float:
    """Return what a transform of at least this size costs, in cells of the fastest."""
    return float(_cost(_quick_size(rows)) * _cost(_quick_size(cols)))


def make_transform(rows: int, cols: int) -> Transform:
    """Return the faster transform for planes of at least this size."""
    if _has_ipp():
        return OpenCVTransform(rows, cols)
    return SciPyTransform(rows, cols)


def _has_ipp() -> bool:
    return hasattr(cv2, 'ipp') and bool(cv2.ipp.useIPP())


@lru_cache(maxsize=256)
def _quick_size(least: int) -> int:
    """
    Return a size of at least this that IPP transforms fast.

    Small prime factors are up to six times faster than others, and many factors of two faster
    again by what `ODD_COST` says (design choice: estimates of the time).

    """
    first = -(-least // MULTIPLE) * MULTIPLE
    sizes = (size for size in range(first, 2 * first + 1, MULTIPLE) if _is_smooth(size))
    return min(islice(sizes, SIZES_TRIED), key=_cost)


def _is_smooth(size: int) -> bool:
    for prime in (2, 3, 5, 7, 13):
        while size % prime == 0:
            size //= prime
    return size == 1


def _cost(size: int) -> float:
    """Return a multiple of 4, made dearer the less often it can be halved."""
    return size * ODD_COST[max(step for step in ODD_COST if size % step == 0)]


class OpenCVTransform:
    """Transform of OpenCV, of whole planes: its option for zero rows would disable IPP."""

    def __init__(self, rows: int, cols: int) -> None:
        self.shape = _quick_size(rows), _quick_size(cols)

    def forward(self, plane: Plane, rows: int, out: Plane) -> None:
        """Transform a plane."""
        cv2.dft(channels(plane), dst=channels(out))

    def backward(self, spectrum: Plane, rows: int, out: Plane) -> Plane:
        """Return the transform of a spectrum, in `out`."""
        self.forward(spectrum, rows, out)
        return out


def channels(plane: Plane) -> Floats:
    """Return the real and the imaginary part (rows, cols, 2) of a plane, without a copy."""
    return plane.view(np.float32).reshape(*plane.shape, 2)


class SciPyTransform:
    """SciPy's transform; rows that are zero, or not wanted, are left out."""

    def __init__(self, rows: int, cols: int) -> None:
        self.shape = fft.next_fast_len(rows), fft.next_fast_len(cols)

    def forward(self, plane: Plane, rows: int, out: Plane) -> None:
        """Transform a plane of which only the first rows are not zero."""
        along = fft.fft(plane[:rows], axis=1)
        out[...] = fft.fft(along, self.shape[0], axis=0, overwrite_x=True)

    def backward(self, spectrum: Plane, rows: int, out: Plane) -> Plane:
        """Return the first rows of the transform of a spectrum."""
        down = fft.fft(spectrum, axis=0)[:rows]
        return np.asarray(fft.fft(down, axis=1, overwrite_x=True))
