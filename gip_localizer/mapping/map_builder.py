# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Build a map from views with known poses by maximal ratio combining with the paper's weights.

The best estimate of a cell that was seen several times is `Σ G v / Σ G`. Near views have large
footprints and therefore large weights. The scatter between frames gives the noise of a cell.

"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.mapping.cell_noise import cell_noise, G, GV, KINDS, spill
from gip_localizer.mapping.exposure import Exposure, fit_exposure
from gip_localizer.mapping.splatting import draw, Drawn
from gip_localizer.mapping.tiles import Box, TiledSums

LEAST_WEIGHT = 400.0
"""Least weight of a cell, 1/grey²: 1/0.05², so that its grey is known to 0.05; chosen."""
BLOCK_SIDES = (6, 3, 1)
"""Cells per side of the blocks for comparing exposures, in order of preference; chosen."""
FULL = 65535.0
"""Full scale of the grey of a map with 16 bits: 2^16 - 1."""
BRIGHT = 0.999
"""Share of the cells that must not exceed full scale (design choice: glints may)."""


class MapBuilder:
    """
    Accumulates views in a map whose grid is aligned with the frame of the poses.

    Parameters
    ----------
    resolution : float
        Side of a map cell, metres.

    Attributes
    ----------
    frames, without_overlap : int
        Number of frames in the map, and of those that overlapped no earlier one.
    exposures : list of Exposure
        Of each frame, relative to the first.
    scale : float
        Grey of the map at the exposure of the first frame; below 1 where cells would exceed full
        scale.

    """

    def __init__(self, resolution: float) -> None:
        self.scale = 1.0
        self.resolution = resolution
        self.frames = 0
        self.without_overlap = 0
        self.exposures: list[Exposure] = []
        self._sums = TiledSums(KINDS)

    def add(self, view: View, weight: Floats, T_map_base: Pose2) -> bool:
        """
        Add a frame.

        The map has the exposure of the first frame. The exposure of each further frame is fitted
        to the map. A frame that does not overlap the map takes the exposure of the last frame.

        Parameters
        ----------
        view : View
            View whose cells are not larger than those of the map.
        weight : (rows, cols) float32
            Gramian of the view, 1/grey²; 0 excludes a cell.
        T_map_base : Pose2
            Pose of the vehicle.

        Returns
        -------
        bool
            False if the view covers no cell of the map; nothing is added then.

        Raises
        ------
        MapError
            The map would become too large for the memory.

        """
        layers = (view.patch, spill(view, self.resolution))
        drawn = draw(layers, weight, view.grid, T_map_base, self.resolution)
        if not drawn.weight.any():
            return False
        exposure = self._exposure(drawn)
        value = (drawn.layers[0] - exposure.offset) / exposure.gain
        each = drawn.weight * exposure.gain**2
        self._sums.add(drawn.box, np.stack([each, each * value, each * value**2, each**2,
                                           each * drawn.layers[1]]))
        self.exposures.append(exposure)
        self.frames += 1
        return True

    def _exposure(self, drawn: Drawn) -> Exposure:
        if self.frames == 0:
            return Exposure()
        held = self._sums.window(drawn.box)
        for side in BLOCK_SIDES:
            found = fit_exposure(*downsampled_both(drawn, held, side))
            if found is not None:
                return found
        self.without_overlap += 1
        return self.exposures[-1]

    def map(self) -> RasterMap:
        """
        Return the map: 16-bit grey and noise of each cell; cells of enough weight are valid.

        Raises
        ------
        MapError
            No cell has enough weight.

        """
        sums = self._sums.window(self._sums.bounds())
        valid = sums[G] >= LEAST_WEIGHT
        if not valid.any():
            raise MapError(
                'no cell of the map was seen well enough; check camera.* and birdseye.* with '
                'gip check-calibration'
            )
        rows, cols = (np.flatnonzero(valid.any(axis=axis)) for axis in (1, 0))
        part = (slice(rows[0], rows[-1] + 1), slice(cols[0], cols[-1] + 1))
        sums, valid = sums[(slice(None), *part)], valid[part]
        box = self._sums.bounds()
        corner = Box(box.row + int(rows[0]), box.col + int(cols[0]), *valid.shape)
        grey = np.where(valid, sums[GV] / np.maximum(sums[G], 1e-30), 0.0)
        noise = np.where(valid, cell_noise(sums, valid), 1.0)
        # A first frame that was darker than others gives greys above 1; matches know no gain.
        self.scale = min(1.0 / max(float(np.quantile(grey[valid], BRIGHT)), 1e-9), 1.0)
        grey, noise = grey * self.scale, np.where(valid, noise * self.scale, 1.0)
        return RasterMap(
            _to_16_bits(grey[::-1], np.round), self.resolution,
            Pose2(corner.col * self.resolution, corner.row * self.resolution, 0.0),
            np.ascontiguousarray(valid[::-1]), _to_16_bits(noise[::-1], np.ceil),
        )


def downsampled_both(
    drawn: Drawn, held: Floats, side: int
) -> tuple[Floats, Floats, tuple[Floats, Floats]]:
    """
    Return block means of frame and map where both hold data, (n,) each, and their variances.

    Distant views are blurred. Compared cell by cell, a near view has more contrast than a map
    that was built from distant views; compared by blocks, both have the same contrast.

    """
    rows, cols = (length // side * side for length in drawn.box[2:])
    weight, value = drawn.weight[:rows, :cols], drawn.layers[0, :rows, :cols]
    total, sums = held[G, :rows, :cols], held[GV, :rows, :cols]
    both = (weight > 0.0) & (total > 0.0)
    safe, safe_total = np.where(both, weight, 1.0), np.where(both, total, 1.0)
    share = np.where(both, 1.0 / (1.0 / safe + 1.0 / safe_total), 0.0)

    def block(cells: Floats) -> Floats:
        return np.asarray(cells.reshape(rows // side, side, cols // side, side).sum(axis=(1, 3)))

    full = block(both.astype(float)) >= side**2
    shares = block(share)[full]
    frame, reference = (
        block(share * cells)[full] / shares for cells in (value, sums / safe_total)
    )
    noise_sq = [block(share**2 / cells)[full] / shares**2 for cells in (safe, safe_total)]
    return frame, reference, (noise_sq[0], noise_sq[1])


def _to_16_bits(values: Floats, rounding: Callable[[Floats], Floats]) -> Floats:
    """Return values of [0, 1] as 16-bit integers."""
    return np.ascontiguousarray(rounding(np.clip(values, 0.0, 1.0) * FULL)).astype(np.uint16)
