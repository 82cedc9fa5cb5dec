# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of one match: the bird's-eye view, and the map beside it where it was found."""

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
"""Columns between two parts of a picture."""
NO_DATA = (96, 48, 48)
"""Blue, green and red of cells without data."""
REACH = (1.0, 99.0)
"""Percentiles of a part that become black and white."""


def birdseye_picture(view: View) -> Picture:
    """Return the view as (rows, cols) grey, stretched to its contrast; black where unseen."""
    return np.where(view.valid, stretched(view.patch, view.valid), 0).astype(np.uint8)


def stretched(values: Floats32, valid: Bools) -> Picture:
    """Return grey between the percentiles of what is valid as 0 to 255; black without any."""
    if not valid.any():
        return np.zeros(values.shape, np.uint8)
    low, high = np.percentile(values[valid], REACH)
    scaled = (values - low) / max(high - low, 1e-6)
    return np.round(255.0 * np.clip(scaled, 0.0, 1.0)).astype(np.uint8)


def comparison_picture(raster_map: RasterMap, view: View, pose: Pose2) -> Picture:
    """
    Show the view, the map window of a pose, and both in one, side by side.

    Returns
    -------
    (rows, 3 * cols + 2 * GAP, 3) uint8
        Blue, green, red. In the third part the view is red and the map is green and blue:
        where they agree it is grey.

    """
    window, share = map_window(raster_map, view.grid, pose)
    known = share > 0.0
    seen = stretched(view.patch, view.valid)
    mapped = stretched(window, known)
    both = np.dstack([mapped, mapped, seen])
    gap = np.full((view.grid.rows, GAP, 3), 255, np.uint8)
    parts = [
        _painted(np.dstack([seen] * 3), view.valid), gap,
        _painted(np.dstack([mapped] * 3), known), gap,
        _painted(both, known & view.valid),
    ]  # fmt: skip
    return np.hstack(parts)


def _painted(picture: Picture, valid: Bools) -> Picture:
    return np.where(valid[:, :, None], picture, np.array(NO_DATA, np.uint8)).astype(np.uint8)
