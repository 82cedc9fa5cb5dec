# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Check of the arrays and numbers of a map."""

from __future__ import annotations

import math

from gip_localizer.core.arrays import Bools, Grey, WHITE
from gip_localizer.core.map.resampling import all_finite
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError


def check_map(
    grey: Grey, resolution: float, origin: Pose2, valid: Bools | None, noise: Grey | None
) -> None:
    """Check the attributes of a `RasterMap`; raise MapError if they are not those of a map."""
    if grey.ndim != 2 or grey.size == 0 or grey.dtype not in WHITE:
        raise MapError(
            f'map array has shape {grey.shape} and type {grey.dtype}; '
            'expected rows x columns of uint8, uint16 or float32'
        )
    if not (math.isfinite(resolution) and resolution > 0.0):
        raise MapError(f'map resolution is {resolution}; expected metres per cell > 0')
    if not origin.is_finite():
        raise MapError(f'map origin is {tuple(origin)}; expected finite x, y, yaw')
    if valid is not None and valid.shape != grey.shape:
        raise MapError(
            f'map mask has shape {valid.shape}, the map {grey.shape}'
        )
    if noise is not None and (
        noise.shape != grey.shape or noise.dtype not in WHITE
    ):
        raise MapError(
            f'map noise has shape {noise.shape} and type {noise.dtype}; expected '
            f'that of the map, {grey.shape}, of uint8, uint16 or float32'
        )
    for name, values in (('grey', grey), ('noise', noise)):
        if values is not None and not all_finite(values):
            raise MapError(
                f'map {name} holds NaN or infinity; expected finite numbers, and cells that '
                'are unknown marked False in `valid`'
            )
