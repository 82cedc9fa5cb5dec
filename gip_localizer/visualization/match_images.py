# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of one match: the bird's-eye view next to the map at the matched pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import map_window
from gip_localizer.core.pose import Pose2

Picture = NDArray[np.uint8]
Floats32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

GAP = 4
"""Width of the gap between two parts of a picture, px; chosen."""
NO_DATA = (96, 48, 48)
"""Colour of cells without data: blue, green, red, 0 to 255; chosen."""
REACH = (1.0, 99.0)
"""Percentiles of the grey values that are shown as black and as white; chosen."""


def birdseye_picture(view: View) -> Picture:
    """Return the view as (rows, cols) grey, stretched to its contrast; black where not seen."""
    return np.where(view.valid, stretched(view.patch, view.valid), 0).astype(np.uint8)


def stretched(values: Floats32, valid: Bools) -> Picture:
    """Return grey stretched between percentiles to 0 to 255; black if no cell is valid."""
    if not valid.any():
        return np.zeros(values.shape, np.uint8)
    low, high = np.percentile(values[valid], REACH)
    scaled = (values - low) / max(high - low, 1e-6)
    return np.round(255.0 * np.clip(scaled, 0.0, 1.0)).astype(np.uint8)


def comparison_picture(raster_map: RasterMap, view: View, pose: Pose2) -> Picture:
    """
    Show three parts side by side: the view, the map at a pose, and both in one.

    Returns
    -------
    (rows, 3 * cols + 2 * GAP, 3) uint8
        Blue, green, red. In the third part the view is red and the map is green and blue: where
        they agree, the picture is grey.

    """
    window, share = map_window(raster_map, view.grid, pose)
    known = share > 0.0
    seen = stretched(view.patch, view.valid)
    mapped = stretched(window, known)
    both = np.dstack([mapped, mapped, seen])
    gap = np.full((view.grid.rows, GAP, 3), 255, np.uint8)
    parts = [
        painted(np.dstack([seen] * 3), view.valid), gap,
        painted(np.dstack([mapped] * 3), known), gap,
        painted(both, known & view.valid),
    ]  # fmt: skip
    return np.hstack(parts)


def painted(picture: Picture, valid: Bools) -> Picture:
    """Return blue, green, red with the cells that are not valid in `NO_DATA`, unlike any paint."""
    return np.where(valid[:, :, None], picture, np.array(NO_DATA, np.uint8)).astype(np.uint8)
