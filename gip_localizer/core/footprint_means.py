# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The product of the footprint matrix with an image, in bands of rows on two threads.

A band's pixels are converted to float32 right before its product, into room that stays, so that
they are still in the core's cache; SciPy releases Python's lock during the product.

"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.threads import in_parallel, WORKERS

BANDS_PER_WORKER = 2


@dataclass(frozen=True, eq=False)
class _Band:
    """Some cells, the image rows that they see, their matrix, and room for the pixels."""

    cells: slice
    rows: slice
    matrix: sparse.csr_matrix
    pixels: Floats


class FootprintMeans:
    """
    Means over footprints, computed one image at a time.

    Parameters
    ----------
    matrix : (cells, rows * width) sparse float32
        Weights of the pixels in each cell.
    width : int
        Pixels in a row of the image.

    """

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
        """
        Return the means of an image.

        Parameters
        ----------
        image : (rows, width) uint8, uint16 or float32
            Need not be contiguous.
        scale : float
            Factor on the means.

        Returns
        -------
        (cells,) float32
            A new array; 0 for cells without pixels.

        """
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
