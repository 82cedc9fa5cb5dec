# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 1: camera image → bird's-eye view.

The value of a cell is the mean of the image over the cell's footprint, so that its noise
variance is N0/Ã (paper, section on image acquisition noise): one sparse product per frame with
the overlap matrix of the calibration.

"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from gip_localizer.core.arrays import Bools, Floats, Grey
from gip_localizer.core.birdseye.footprint_means import FootprintMeans
from gip_localizer.core.birdseye.footprints import footprint_areas, overlap_matrix, pixel_box
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye

# Least value (of 255) of a mask for pixels that are used: half of full scale.
MASK_USED = 128
# Least number of cells of a view (design choice: 20, because a fit has up to 8 unknowns).
MIN_CELLS = 20
# Least share (no unit) of the footprint of a cell that is not masked (design choice: 0.99, which
# is 1 less rounding).
WHOLE = 0.99
# Least footprint (px²) of a cell (design choice: 0.02, about one sub-pixel of a far pixel).
MIN_FOOTPRINT = 0.02


@dataclass(frozen=True, eq=False)
class View:
    """
    One bird's-eye view.

    Attributes
    ----------
    patch : (rows, cols) float32
        Mean grey over each cell's footprint, [0, 1]; 0 where not valid.
    footprint : (rows, cols) float32
        Ã, footprint area in px²; 0 where not valid.
    valid : (rows, cols) bool
        The cell is seen whole.
    grid : Grid
        Where the cells are in the base frame.

    """

    patch: Floats
    footprint: Floats
    valid: Bools
    grid: Grid


class Rectifier:
    """
    The map from an image to a bird's-eye view, for one camera and one grid.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera and its extrinsics.
    birdseye : Birdseye
        SearchWindow and resolution of the view.

    Raises
    ------
    CalibrationError
        The camera sees (almost) nothing of the road inside the view.

    """

    def __init__(self, camera: CameraModel, birdseye: Birdseye) -> None:
        self.camera = camera
        self.grid = make_grid(birdseye)
        areas, valid = footprint_areas(camera, self.grid)
        valid &= areas > MIN_FOOTPRINT
        if valid.sum() < MIN_CELLS:
            raise CalibrationError(_no_road(camera, birdseye, int(valid.sum())))
        self._box = pixel_box(camera, self.grid, valid)
        self._overlap = overlap_matrix(camera, self.grid, valid, self._box)
        sums = np.asarray(self._overlap.sum(axis=1)).ravel()
        self.valid: Bools = valid & (sums > 0.0).reshape(valid.shape)
        if self.valid.sum() < MIN_CELLS:
            raise CalibrationError(_no_road(camera, birdseye, int(self.valid.sum())))
        self.footprint = np.where(self.valid, areas, 0.0).astype(np.float32)
        self._means = FootprintMeans(self._overlap, self._box.width)

    def rectify(self, image: Grey) -> View:
        """
        Average the image over the cells' footprints.

        Parameters
        ----------
        image : (height, width) uint8, uint16 or float32
            Grey image of the camera's size; floats are in [0, 1].

        Returns
        -------
        View
            The cells; invalid ones hold 0.

        """
        patch = self._means.of(image[self._box.slices])
        return View(patch.reshape(self.grid.shape), self.footprint, self.valid, self.grid)

    @cached_property
    def centroids(self) -> Floats:
        """
        Centroids (rows * cols, 2) of the pixels on each cell, metres in base.

        The near side of a cell covers more pixels than its far side, so that its mean is that
        of a point nearer than its middle: by r²/12 times the gradient of the footprint's
        logarithm.

        """
        area = np.where(self.valid, self.footprint, np.nan).astype(np.float64)
        step = self.grid.resolution
        with np.errstate(invalid='ignore'):
            down, right = np.gradient(np.log(area), step)
        # rows run towards -x, columns towards -y
        shift = np.nan_to_num(np.stack([-down, -right], axis=-1)) * step**2 / 12.0
        return self.grid.points() + np.clip(shift, -0.25 * step, 0.25 * step).reshape(-1, 2)

    def unmasked(self, mask: Grey) -> Floats:
        """
        Return 1 for cells whose whole footprint is not masked, else 0, (rows, cols) float32.

        Parameters
        ----------
        mask : (height, width) uint8 or bool
            Of the camera's size; pixels below `MASK_USED`, or False, are masked.

        """
        seen = (mask if mask.dtype == bool else mask >= MASK_USED).astype(np.float32)
        return (self.rectify(seen).patch > WHOLE).astype(np.float32)

    @cached_property
    def pixel_blur(self) -> sparse.csr_matrix:
        """
        What the camera's pixels do to a road of cells, (n, n) over the valid cells.

        `S = D⁻¹ O N⁻¹ Oᵀ` with the overlaps O, footprints D and pixel sums N: cells → pixels →
        cells. Near cells pass unchanged, far cells mix with those that share their pixels.

        """
        overlap = self._overlap[self.valid.ravel()]
        pixel_sums = np.asarray(overlap.sum(axis=0)).ravel()
        inverse = np.divide(1.0, pixel_sums, out=np.zeros_like(pixel_sums),
                            where=pixel_sums > 1e-6)
        mean = self._means.matrix[self.valid.ravel()]
        blur = (mean @ sparse.diags(inverse.astype(np.float32)) @ overlap.T).tocsr()
        blur.data[blur.data < 1e-4] = 0.0
        blur.eliminate_zeros()
        sums = np.asarray(blur.sum(axis=1)).ravel()
        return (sparse.diags((1.0 / sums).astype(np.float32)) @ blur).tocsr()


def make_grid(birdseye: Birdseye) -> Grid:
    """Return the cells of the view; the near edge and the width are rounded to whole cells."""
    rows = max(round((birdseye.far - birdseye.near) / birdseye.resolution), 1)
    cols = max(round(2.0 * birdseye.half_width / birdseye.resolution), 1)
    left = 0.5 * cols * birdseye.resolution
    far = birdseye.near + rows * birdseye.resolution
    return Grid(far, left, rows, cols, birdseye.resolution)


def _no_road(camera: CameraModel, birdseye: Birdseye, seen: int) -> str:
    pose = camera.extrinsics
    middle = np.array([[camera.width / 2.0, camera.height - 1.0]])
    xy, on_road = camera.road_points(middle)
    sight = (
        f'the lowest row of the image meets the road {xy[0, 0]:.2f} m ahead of base_link'
        if on_road[0] else 'the camera sees no road at all'
    )
    return (
        f'no road in view: {seen} whole cells between birdseye.near {birdseye.near:g} m and '
        f'birdseye.far {birdseye.far:g} m ({sight}; camera.z {pose.z:g} m, camera.pitch '
        f'{pose.pitch:g} rad, positive is nose down); correct the extrinsics or the view'
    )
