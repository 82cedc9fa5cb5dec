# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether odometry is believed: its motion compared with the motion between fixes.

Odometry that stays at zero, is of another vehicle or in other units is well-formed, and only the
matches show that it is wrong. It is therefore believed once it has agreed with fixes over a motion
that would have shown an error, and rejected at the first contradiction. Until it is believed the
velocity of the fixes is held instead.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.pose import Pose2, wrap_angle

SLACK_XY, SLACK_YAW = 0.1, 0.02
"""Metres and radians by which two motions may differ besides their uncertainty."""
SIGMAS = 3.0
"""Standard deviations of their difference by which two motions may differ."""
SPAN_S = 1.0
"""Seconds over which motions are compared, so that a slow error shows too."""
AGREEMENTS_AGAIN = 3
"""Consecutive agreements before rejected odometry is believed again."""
MAX_ACCELERATION, MAX_TURN_ACCELERATION = 20.0, 10.0
"""Of a road vehicle, m/s² and rad/s², with a margin: a faster change of motion is a fault."""


@dataclass
class OdometryCheck:
    """
    Judges odometry by the fixes.

    Attributes
    ----------
    believed : bool
        Odometry has agreed with fixes, and nothing has contradicted it since.
    detail : str
        The last contradiction; empty while there is none.

    """

    believed: bool = False
    detail: str = ''
    _agreements: int = 0

    @property
    def rejected(self) -> bool:
        """Whether odometry has contradicted fixes, and has not agreed with them since."""
        return bool(self.detail)

    def usable(self, told: Pose2, held: Pose2 | None, elapsed: float) -> bool:
        """
        Whether a motion by odometry may move the belief.

        Parameters
        ----------
        told : Pose2
            By odometry, metres and radians.
        held : Pose2 or None
            By the velocity of the last fixes; None where there is none.
        elapsed : float
            Seconds that both took.

        """
        if not self.believed or held is None:
            return self.believed
        apart = math.hypot(told.x - held.x, told.y - held.y)
        turned = abs(wrap_angle(told.yaw - held.yaw))
        return (
            apart <= SLACK_XY + MAX_ACCELERATION * elapsed**2
            and turned <= SLACK_YAW + MAX_TURN_ACCELERATION * elapsed**2
        )

    def compare(
        self, told: Pose2, seen: Pose2, *, sigma_xy: float, sigma_yaw: float, elapsed: float
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
        most = SLACK_XY + SIGMAS * sigma_xy
        if apart > most or turned > SLACK_YAW + SIGMAS * sigma_yaw:
            self.believed = False
            self._agreements = 0
            self.detail = (
                f'odometry reports a motion of ({told.x:.2f} m, {told.y:.2f} m, '
                f'{told.yaw:.3f} rad) in {elapsed:.2f} s, the matches ({seen.x:.2f} m, '
                f'{seen.y:.2f} m, {seen.yaw:.3f} rad)'
            )
            return True
        if elapsed < SPAN_S:
            return False
        if math.hypot(seen.x, seen.y) > most:  # odometry at zero would have contradicted
            self._agreed()
        return True

    def _agreed(self) -> None:
        self._agreements += 1
        if not self.rejected or self._agreements >= AGREEMENTS_AGAIN:
            self.believed = True
            self.detail = ''
