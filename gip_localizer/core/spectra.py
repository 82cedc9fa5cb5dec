# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Real two-dimensional transforms in float32, by the faster of two libraries.

OpenCV with Intel's IPP takes a third of the time of SciPy's; without IPP, twice the time. The
choice depends on OpenCV's build alone, so that equal inputs give equal bytes.

"""

from __future__ import annotations

from functools import lru_cache
from itertools import islice
from typing import Any, Protocol

import cv2
import numpy as np
from scipy import fft

from gip_localizer.core.arrays import Floats

SIZES_TRIED = 8
ODD_COST = {32: 1.0, 16: 1.08, 8: 1.17, 4: 1.17}
"""Time per cell of sizes that are multiples of so many, and of no more."""
Spectrum = Any  # layout known to its transform alone


class Transform(Protocol):
    """
    Transforms of planes (rows, cols) float32, which may be larger than what is put in.

    Attributes
    ----------
    shape : (int, int)
        Rows and columns of the planes.

    """

    shape: tuple[int, int]

    def empty(self) -> Spectrum:
        """Return room for one spectrum."""
        ...

    def field(self, plane: Floats, rows: int) -> Spectrum:
        """Transform a map field, of which only the first rows are not zero, for `correlated`."""
        ...

    def forward(self, plane: Floats, rows: int, out: Spectrum) -> None:
        """Transform a template of which only the first rows are not zero."""
        ...

    def correlated(self, field: Spectrum, template: Spectrum, out: Spectrum) -> None:
        """Write the spectrum of the correlation of a field and a template."""
        ...

    def add(self, total: Spectrum, spectrum: Spectrum) -> None:
        """Add a spectrum to another."""
        ...

    def inverse(self, product: Spectrum, out: Floats, room: Spectrum) -> None:
        """Write the first rows and columns of a correlation; overwrites `room`."""
        ...


def cost(rows: int, cols: int) -> float:
    """Return what a transform of at least this size costs, in cells of the fastest."""
    return float(_cost(_quick_size(rows, 4)) * _cost(_quick_size(cols, 8)))


def make_transform(rows: int, cols: int) -> Transform:
    """Return the faster transform for planes of at least this size."""
    if _has_ipp():
        return OpenCVTransform(rows, cols)
    return SciPyTransform(rows, cols)


def _has_ipp() -> bool:
    return hasattr(cv2, 'ipp') and bool(cv2.ipp.useIPP())


class _Packed:
    """
    A spectrum in OpenCV's packed (CCS) layout, (rows, cols) float32.

    The first and the last column hold two real transforms of their own (`edges`), and between
    them lie complex numbers, which NumPy multiplies four times faster than `cv2.mulSpectrums`.
    As one run (`inner`), the end of a row and the beginning of the next make a number too, which
    means nothing.

    """

    def __init__(self, shape: tuple[int, int]) -> None:
        self.whole = np.zeros(shape, np.float32)
        self.inner = self.whole.reshape(-1)[1:-1].view(np.complex64)
        self.outer = self.whole[:, :: shape[1] - 1]
        self.edges = np.empty((shape[0], 2), np.float32)


@lru_cache(maxsize=256)
def _quick_size(least: int, multiple: int) -> int:
    """
    Return a size of at least this and a multiple of `multiple` that IPP transforms fast.

    Small prime factors are up to six times faster than others, and many factors of two faster
    again by what `ODD_COST` says (measured).

    """
    first = -(-least // multiple) * multiple
    sizes = (size for size in range(first, 2 * first + 1, multiple) if _is_smooth(size))
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
    """
    OpenCV's transform.

    A field's spectrum is kept scaled and conjugate, so that a product is one multiplication; the
    correlation then comes out with its indices negated.

    """

    def __init__(self, rows: int, cols: int) -> None:
        self.shape = _quick_size(rows, 4), _quick_size(cols, 8)

    def empty(self) -> _Packed:
        """Return room for one spectrum."""
        return _Packed(self.shape)

    def field(self, plane: Floats, rows: int) -> _Packed:
        """Transform a map field."""
        out = self.empty()
        self.forward(plane, rows, out)
        out.whole *= np.float32(1.0 / plane.size)
        out.edges *= np.float32(1.0 / plane.size)
        np.conjugate(out.inner, out=out.inner)
        return out

    def forward(self, plane: Floats, rows: int, out: _Packed) -> None:
        """Transform a plane (telling OpenCV of zero rows would switch IPP off)."""
        cv2.dft(plane, dst=out.whole)
        np.copyto(out.edges, out.outer)

    def correlated(self, field: _Packed, template: _Packed, out: _Packed) -> None:
        """Write conj(field) x template."""
        np.multiply(field.inner, template.inner, out=out.inner)
        cv2.mulSpectrums(template.edges, field.edges, 0, c=out.edges, conjB=True)

    def add(self, total: _Packed, spectrum: _Packed) -> None:
        """Add a spectrum to another."""
        total.inner += spectrum.inner
        total.edges += spectrum.edges

    def inverse(self, product: _Packed, out: Floats, room: _Packed) -> None:
        """Write the first rows and columns, whose indices are negative here."""
        np.copyto(product.outer, product.edges)
        flags = cv2.DFT_INVERSE | cv2.DFT_REAL_OUTPUT
        plane = np.asarray(cv2.dft(product.whole, dst=room.whole, flags=flags))
        out[0, 0], out[0, 1:] = plane[0, 0], plane[0, : -out.shape[1] : -1]
        out[1:, 0] = plane[: -out.shape[0] : -1, 0]
        out[1:, 1:] = plane[: -out.shape[0] : -1, : -out.shape[1] : -1]


class SciPyTransform:
    """SciPy's transform; rows that are zero, or not wanted, are left out."""

    def __init__(self, rows: int, cols: int) -> None:
        self.shape = (fft.next_fast_len(rows), fft.next_fast_len(cols, real=True))

    def empty(self) -> Spectrum:
        """Return room for one spectrum."""
        return np.empty((self.shape[0], self.shape[1] // 2 + 1), np.complex64)

    def field(self, plane: Floats, rows: int) -> Spectrum:
        """Transform a map field."""
        out = self.empty()
        self.forward(plane, rows, out)
        return out

    def forward(self, plane: Floats, rows: int, out: Spectrum) -> None:
        """Transform a plane of which only the first rows are not zero."""
        along = fft.rfft(plane[:rows], axis=1)
        out[...] = fft.fft(along, self.shape[0], axis=0, overwrite_x=True)

    def correlated(self, field: Spectrum, template: Spectrum, out: Spectrum) -> None:
        """Write field x conj(template)."""
        np.conjugate(template, out=out)
        np.multiply(field, out, out=out)

    def add(self, total: Spectrum, spectrum: Spectrum) -> None:
        """Add a spectrum to another."""
        total += spectrum

    def inverse(self, product: Spectrum, out: Floats, room: Spectrum) -> None:
        """Write the first rows and columns."""
        down = fft.ifft(product, axis=0)[: out.shape[0]]
        out[...] = fft.irfft(down, self.shape[1], axis=1)[:, : out.shape[1]]
