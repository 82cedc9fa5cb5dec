# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Real two-dimensional transforms in float32, by the faster of two libraries.

OpenCV with Intel's IPP takes a third of the time of SciPy's; without IPP, twice the time. The
choice depends on OpenCV's build alone, so that equal inputs give equal bytes.

"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from gip_localizer.core.arrays import Floats

Spectrum = NDArray[Any]  # layout known to its transform alone


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

    def forward(self, plane: Floats, rows: int, out: Spectrum) -> Spectrum:
        """Transform a plane of which only the first rows are not zero."""
        ...

    def correlated(self, field: Spectrum, template: Spectrum, out: Spectrum) -> Spectrum:
        """Return the spectrum of the correlation, field x conj(template)."""
        ...

    def inverse(self, product: Spectrum, size: tuple[int, int], out: Floats) -> Floats:
        """Return the first rows and columns of the plane of a spectrum; may use `out`."""
        ...


def make_transform(rows: int, cols: int) -> Transform:
    """Return the faster transform for planes of at least this size."""
    if _has_ipp():
        return OpenCVTransform(rows, cols)
    return SciPyTransform(rows, cols)


def _has_ipp() -> bool:
    return hasattr(cv2, 'ipp') and bool(cv2.ipp.useIPP())


class OpenCVTransform:
    """OpenCV's transform, spectra in its packed (CCS) layout."""

    def __init__(self, rows: int, cols: int) -> None:
        # multiples of 4 and 8 with small prime factors: up to six times faster than others
        self.shape = (4 * fft.next_fast_len(-(-rows // 4)), 8 * fft.next_fast_len(-(-cols // 8)))

    def empty(self) -> Spectrum:
        """Return room for one spectrum."""
        return np.empty(self.shape, np.float32)

    def forward(self, plane: Floats, rows: int, out: Spectrum) -> Spectrum:
        """Transform a plane (telling OpenCV of zero rows would switch IPP off)."""
        return np.asarray(cv2.dft(plane, dst=out))

    def correlated(self, field: Spectrum, template: Spectrum, out: Spectrum) -> Spectrum:
        """Return field x conj(template)."""
        return np.asarray(cv2.mulSpectrums(field, template, 0, c=out, conjB=True))

    def inverse(self, product: Spectrum, size: tuple[int, int], out: Floats) -> Floats:
        """Return the first rows and columns of the plane."""
        flags = cv2.DFT_INVERSE | cv2.DFT_SCALE | cv2.DFT_REAL_OUTPUT
        plane = np.asarray(cv2.dft(product, dst=out, flags=flags))
        return plane[: size[0], : size[1]]


class SciPyTransform:
    """SciPy's transform; rows that are zero, or not wanted, are left out."""

    def __init__(self, rows: int, cols: int) -> None:
        self.shape = (fft.next_fast_len(rows), fft.next_fast_len(cols, real=True))

    def empty(self) -> Spectrum:
        """Return room for one spectrum."""
        return np.empty((self.shape[0], self.shape[1] // 2 + 1), np.complex64)

    def forward(self, plane: Floats, rows: int, out: Spectrum) -> Spectrum:
        """Transform a plane of which only the first rows are not zero."""
        along = fft.rfft(plane[:rows], axis=1)
        return np.asarray(fft.fft(along, self.shape[0], axis=0, overwrite_x=True))

    def correlated(self, field: Spectrum, template: Spectrum, out: Spectrum) -> Spectrum:
        """Return field x conj(template)."""
        np.conjugate(template, out=out)
        return np.asarray(np.multiply(field, out, out=out))

    def inverse(self, product: Spectrum, size: tuple[int, int], out: Floats) -> Floats:
        """Return the first rows and columns of the plane."""
        down = fft.ifft(product, axis=0)[: size[0]]
        return np.asarray(fft.irfft(down, self.shape[1], axis=1)[:, : size[1]])
