# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How accurately a map shows where the road lies in the map frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats


class MapAccuracy(NamedTuple):
    """
    Standard deviations of the place at which the map shows a part of the road.

    Attributes
    ----------
    sigma_xy : float
        Of x and of y, metres.
    sigma_yaw : float
        Of the direction, rad.

    """

    sigma_xy: float = 0.0
    sigma_yaw: float = 0.0

    def at_least(self, other: MapAccuracy) -> MapAccuracy:
        """Return the larger standard deviations of both."""
        return MapAccuracy(*(max(pair) for pair in zip(self, other, strict=True)))

    def covariance(self) -> Floats:
        """Return the covariance (3, 3) of a pose on the map from these errors: m, m, rad."""
        return np.diag(np.square([self.sigma_xy, self.sigma_xy, self.sigma_yaw]))


EXACT = MapAccuracy()
"""A map that shows every part of the road at its place."""
