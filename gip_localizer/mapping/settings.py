# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Settings of `gip map`."""

from __future__ import annotations

from dataclasses import dataclass, field

from gip_localizer.errors import ParameterError
from gip_localizer.io.bags.window import BagWindow


@dataclass(frozen=True)
class MapBuilderSettings:
    """
    Settings for building a map from a drive.

    Attributes
    ----------
    resolution : float
        Side of a map cell, metres.
    every : int
        Every how many frames one is used.
    max_gap_s : float
        Longest time, in seconds, between two poses that are interpolated; the default is chosen.
    window : BagWindow
        Part of the bag.

    """

    resolution: float
    every: int = 1
    max_gap_s: float = 0.2
    window: BagWindow = field(default_factory=BagWindow)

    def __post_init__(self) -> None:
        """Refuse impossible values (raises ParameterError)."""
        if not 0.002 <= self.resolution <= 2.0:
            raise ParameterError(
                f'--resolution {self.resolution}: expected metres per cell from 0.002 to 2'
            )
        if self.every < 1:
            raise ParameterError(f'--every {self.every}: expected a whole number from 1')
        if not 0.0 < self.max_gap_s <= 60.0:
            raise ParameterError(f'--max-gap {self.max_gap_s}: expected seconds up to 60')
