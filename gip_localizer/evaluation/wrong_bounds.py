# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""When a published pose is wrong. Imports little: the parser of `gip` uses it."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.errors import ParameterError


@dataclass(frozen=True)
class WrongBounds:
    """
    Errors above which a published pose is wrong; the defaults, chosen, suit a road vehicle.

    Attributes
    ----------
    xy_m : float
        Position error, metres.
    yaw_deg : float
        Heading error, degrees.

    Raises
    ------
    ParameterError
        A bound is not above zero.

    """

    xy_m: float = 0.5
    yaw_deg: float = 2.0

    def __post_init__(self) -> None:
        """Refuse bounds that are no errors."""
        for option, value, unit in (('--wrong-xy', self.xy_m, 'metres'),
                                    ('--wrong-yaw', self.yaw_deg, 'degrees')):
            if not (value > 0.0 and math.isfinite(value)):
                raise ParameterError(f'{option} {value:g}: expected {unit} above 0')


DEFAULT_BOUNDS = WrongBounds()
"""For all that does not choose its own."""
