# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Input of `GaussNewton`: a frame's cells at one stage, the initial state, the unknowns."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gip_localizer.core.arrays import Floats, Ints
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.refine.local_light import Light
from gip_localizer.core.refine.stages import OPTICAL_TERMS, Stage


@dataclass(frozen=True, eq=False)
class Unknowns:
    """
    The parameters that are estimated in addition to x, y and yaw.

    Attributes
    ----------
    moving : (m,) int
        Components of the camera's motion (pitch, roll, height) that are free.
    prior : (3 + m [+ 2],) float64
        Information of the prior on every unknown; gain and offset come last.
    normalized : bool
        Gain and offset are unknown.
    robust : bool
        Cells that disagree with the map lose their weight.

    """

    moving: Ints
    prior: Floats
    normalized: bool
    robust: bool

    def scales(self, gain: float) -> Floats:
        """Return factors (p,) from the slopes of the map to grey levels of the view."""
        scales = np.full(len(self.prior), gain)
        if self.normalized:
            scales[-2:] = 1.0
        return scales


@dataclass(eq=False)
class RefinementState:
    """
    Pose, camera motion (pitch, roll, height), last step, exposure, shading and light.

    Where the light varies over the road, the light model includes the shading of the lens.

    """

    pose: Pose2
    camera_motion: Floats
    exposure: tuple[float, float] | None = None
    agreement: float = 1.0
    step: Floats = field(default_factory=lambda: np.zeros(3))
    shading: Floats = field(default_factory=lambda: np.zeros(OPTICAL_TERMS))
    light: Light | None = None

    def shade(self, stage: Stage) -> Floats | None:
        """Return the relative gain (n,) of the cells due to shading; None without shading."""
        if not self.shading.any():
            return None
        return np.float32(1.0) + self.shading.astype(np.float32) @ stage.optical


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """
    Errors of a frame, as far as they are known before it is matched.

    Attributes
    ----------
    map_noise : float
        Standard deviation of the map in the view's grey levels, as in the Gramian.
    level : ErrorLevel
        Level of the smooth errors, from earlier frames.

    """

    map_noise: float = 0.0
    level: ErrorLevel = field(default_factory=ErrorLevel)


@dataclass(frozen=True, eq=False)
class Layer:
    """
    Cells of a frame in one stage, and the map with which they are compared.

    Attributes
    ----------
    stage : Stage
        Stage of the cells.
    values, weights : (n,) float32
        Grey and Gramian of the cells.
    raster_map : RasterMap
        Map, smoothed for the size of the cells.
    locking : float
        Largest error (m) of a pose that interpolation between its cell centres may cause.
    blurred_slopes : ((rows, cols) float32, (rows, cols) float32) or None
        `versions.blurred_slopes` of the map, for cells whose error comes from the map; None:
        not used.
    pixel_share : (n,) float32
        Share of the variance of the cells that pixels cause and not the map.
    level : ErrorLevel
        Level of the smooth errors, from earlier frames.

    """

    stage: Stage
    values: Floats
    weights: Floats
    raster_map: RasterMap
    locking: float
    blurred_slopes: tuple[Floats, Floats] | None
    pixel_share: Floats
    level: ErrorLevel
