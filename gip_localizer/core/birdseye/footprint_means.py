# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Means over footprints: 8-bit images by the compiled loop, others by a sparse product.

The product is made in bands of rows on two threads. A band's pixels are converted to float32 right
before its product, into room that stays, so that they are still in the core's cache; SciPy
releases Python's lock during the product.

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats, Grey, WHITE
from gip_localizer.core.birdseye.byte_footprints import ByteFootprints
from gip_localizer.core.birdseye.footprints import PARTS
from gip_localizer.core.kernels.binding import AVAILABLE
from gip_localizer.core.kernels.library import BLOCK
from gip_localizer.core.threads import in_parallel, WORKERS

# Number of parts of an image per thread (design choice: 2, because a late thread then delays the
# image by little).
BANDS_PER_WORKER = 2


class FootprintMeans:
    """
    Means over footprints, computed one image at a time.

    Parameters
    ----------
    overlap : (cells, rows * width) sparse float32
        Share of each pixel on each cell.
    width : int
        Pixels in a row of the image.

    """

    def __init__(self, overlap: sparse.csr_matrix, width: int) -> None:
        self._overlap = overlap
        self._shape = overlap.shape[1] // width, width
        compiled = AVAILABLE and width >= BLOCK
        self._bytes = ByteFootprints(overlap, width, PARTS) if compiled else None

    @cached_property
    def matrix(self) -> sparse.csr_matrix:
        """Weights (cells, rows * width) of the pixels in each cell."""
        sums = np.asarray(self._overlap.sum(axis=1)).ravel()
        inverse = np.divide(1.0, sums, out=np.zeros_like(sums), where=sums > 0.0)
        return (sparse.diags(inverse.astype(np.float32)) @ self._overlap).tocsr()

    def of(self, image: Grey) -> Floats:
        """
        Return the means of an image.

        Parameters
        ----------
        image : (rows, width) uint8, uint16 or float32
            Need not be contiguous.

        Returns
        -------
        (cells,) float32
            A new array of the image's share of white; 0 for cells without pixels.

        Raises
        ------
        ValueError
            The image has another size.

        """
        if image.shape != self._shape:
            raise ValueError(f'image of shape {image.shape}, footprints on {self._shape}')
        if self._bytes is not None and image.dtype == np.uint8:
            return self._bytes.of(image)
        return self._product.of(image, 1.0 / WHITE.get(image.dtype, 1.0))

    @cached_property
    def _product(self) -> _Product:
        return _Product(self.matrix, self._shape[1])


@dataclass(frozen=True, eq=False)
class _Band:
    """Some cells, the image rows that they see, their matrix, and room for the pixels."""

    cells: slice
    rows: slice
    matrix: sparse.csr_matrix
    pixels: Floats


class _Product:
    """The product of a matrix with images of any type."""

    def __init__(self, matrix: sparse.csr_matrix, width: int) -> None:
        self._count = matrix.shape[0]
        count = BANDS_PER_WORKER * WORKERS
        steps = np.linspace(0, matrix.nnz, count + 1)
        cuts = np.searchsorted(matrix.indptr, steps)
        cuts[0], cuts[-1] = 0, self._count
        bands = [
            _band(matrix, slice(int(a), int(b)), width)
            for a, b in pairwise(cuts) if b > a
        ]
        self._shares = [bands[k::WORKERS] for k in range(WORKERS)]

    def of(self, image: Grey, scale: float) -> Floats:
        """Return the product (cells,) float32, times a factor."""
        means = np.empty(self._count, np.float32)

        def work(share: list[_Band]) -> None:
            for band in share:
                np.copyto(band.pixels, image[band.rows], casting='same_kind')
                means[band.cells] = band.matrix @ band.pixels.reshape(-1)
                means[band.cells] *= np.float32(scale)

        in_parallel(work, [share for share in self._shares if share])
        return means


def _band(matrix: sparse.csr_matrix, cells: slice, width: int) -> _Band:
    part = matrix[cells]
    if part.nnz == 0:
        rows = slice(0, 1)
    else:
        rows = slice(int(part.indices.min()) // width, int(part.indices.max()) // width + 1)
    height = rows.stop - rows.start
    moved = sparse.csr_matrix(
        (part.data, part.indices - rows.start * width, part.indptr),
        shape=(part.shape[0], height * width),
    )
    return _Band(cells, rows, moved, np.empty((height, width), np.float32))
