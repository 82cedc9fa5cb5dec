# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether odometry is to be believed: the motion that it tells against that between fixes.

Odometry that stands at zero, is of another vehicle or in other units is well-formed, and only the
matches show that it is wrong. While it is rejected the velocity of the fixes is held instead.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.pose import Pose2, wrap_angle

SLACK_XY, SLACK_YAW = 0.1, 0.02
"""Metres and radians by which two motions may differ besides their uncertainty."""
SIGMAS = 3.0
SPAN_S = 1.0
"""Seconds over which motions are compared, so that a slow error shows too."""
TURNS = 3
"""Comparisons in a row that change the mind."""
MAX_ACCELERATION, MAX_TURN_ACCELERATION = 20.0, 10.0
"""Of a road vehicle, m/s² and rad/s², with a margin: a faster change of motion is a fault."""


@dataclass
class OdometryCheck:
    """
    Judges odometry by the fixes.

    Attributes
    ----------
    rejected : bool
        Odometry is not to be used.
    detail : str
        What the last contradiction was; empty while there is none.

    """

    rejected: bool = False
    detail: str = ''
    _against: int = 0
    _for: int = 0
    _overruled: bool = False

    def usable(self, told: Pose2, held: Pose2 | None, elapsed: float) -> bool:
        """
        Tell whether a motion by odometry may carry the belief.

        Parameters
        ----------
        told : Pose2
            By odometry, metres and radians.
        held : Pose2 or None
            By the velocity of the last fixes; None where there is none.
        elapsed : float
            Seconds that both took.

        """
        self._overruled = False
        if held is None:
            return True  # nothing better is known
        if self.rejected:
            return False
        apart = math.hypot(told.x - held.x, told.y - held.y)
        turned = abs(wrap_angle(told.yaw - held.yaw))
        self._overruled = not self._against and (
            apart > SLACK_XY + MAX_ACCELERATION * elapsed**2
            or turned > SLACK_YAW + MAX_TURN_ACCELERATION * elapsed**2
        )
        return not self._overruled

    def compare(
        self, told: Pose2, seen: Pose2, sigma_xy: float, sigma_yaw: float, elapsed: float
    ) -> bool:
        """
        Learn from the motion between two fixes.

        Parameters
        ----------
        told, seen : Pose2
            By odometry and by the fixes.
        sigma_xy, sigma_yaw : float
            Standard deviations of their difference, metres and radians.
        elapsed : float
            Seconds between the fixes.

        Returns
        -------
        bool
            True when the comparison is done, so that the next begins at the later fix.

        """
        apart = math.hypot(told.x - seen.x, told.y - seen.y)
        turned = abs(wrap_angle(told.yaw - seen.yaw))
        if apart > SLACK_XY + SIGMAS * sigma_xy or turned > SLACK_YAW + SIGMAS * sigma_yaw:
            self._contradicted(
                f'odometry tells a motion of ({told.x:.2f} m, {told.y:.2f} m, {told.yaw:.3f} rad) '
                f'in {elapsed:.2f} s, the matches ({seen.x:.2f} m, {seen.y:.2f} m, '
                f'{seen.yaw:.3f} rad)'
            )
            return True
        if elapsed >= SPAN_S:
            self._agreed()
            return True
        return False

    def _contradicted(self, detail: str) -> None:
        self.detail = detail
        self._for = 0
        self._against += 1
        if self._overruled or self._against >= TURNS:
            self.rejected = True

    def _agreed(self) -> None:
        self._against = 0
        self._for += 1
        if not self.rejected or self._for >= TURNS:
            self.rejected = False
            self.detail = ''
