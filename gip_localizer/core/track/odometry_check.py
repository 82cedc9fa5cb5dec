# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether odometry is used: its motion compared with the motion between fixes.

Odometry that stays at zero, is of another vehicle or in other units is well-formed, and only the
matches show that it is wrong. It is therefore used once it has agreed with fixes over a motion
that would have shown an error, and rejected at the first contradiction. Until then the velocity
of the fixes is used instead.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.pose import Pose2, wrap_angle

# Difference of two motions (m, rad) that is allowed in addition to their uncertainty (design
# choice: time stamps of odometry and images differ by some milliseconds).
SLACK_XY, SLACK_YAW = 0.1, 0.02
# Standard deviations of their difference by which two motions may differ (99.7 %).
SIGMAS = 3.0
# Time (s) over which motions are compared, so that small errors of the velocity add up (design
# choice).
SPAN_S = 1.0
# Consecutive agreements before rejected odometry is used again (design choice).
AGREEMENTS_AGAIN = 3
# Largest accelerations of a road vehicle (m/s², rad/s²): twice what tyres can transmit.
MAX_ACCELERATION, MAX_TURN_ACCELERATION = 20.0, 10.0


@dataclass
class OdometryCheck:
    """
    Compares odometry with the fixes.

    Attributes
    ----------
    believed : bool
        Odometry has agreed with fixes, and no fix has contradicted it since.
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

    def usable(self, measured: Pose2, extrapolated: Pose2 | None, elapsed: float) -> bool:
        """
        Return whether a motion by odometry may move the belief.

        Parameters
        ----------
        measured : Pose2
            By odometry, metres and radians.
        extrapolated : Pose2 or None
            By the velocity of the last fixes; None where there is none.
        elapsed : float
            Duration of both, s.

        """
        if not self.believed or extrapolated is None:
            return self.believed
        distance, turn = _differences(measured, extrapolated)
        return (
            distance <= SLACK_XY + MAX_ACCELERATION * elapsed**2
            and turn <= SLACK_YAW + MAX_TURN_ACCELERATION * elapsed**2
        )

    def compare(
        self, measured: Pose2, by_fixes: Pose2, *, sigma_xy: float, sigma_yaw: float,
        elapsed: float,
    ) -> bool:
        """
        Compare odometry with the motion between two fixes.

        Parameters
        ----------
        measured, by_fixes : Pose2
            Motion by odometry and by the fixes.
        sigma_xy, sigma_yaw : float
            Standard deviations of their difference, metres and radians.
        elapsed : float
            Seconds between the fixes.

        Returns
        -------
        bool
            True when the comparison is finished, so that the next begins at the later fix.

        """
        distance, turn = _differences(measured, by_fixes)
        most = SLACK_XY + SIGMAS * sigma_xy
        if distance > most or turn > SLACK_YAW + SIGMAS * sigma_yaw:
            self.believed = False
            self._agreements = 0
            self.detail = (
                f'odometry reports a motion of ({measured.x:.2f} m, {measured.y:.2f} m, '
                f'{measured.yaw:.3f} rad) in {elapsed:.2f} s, the matches ({by_fixes.x:.2f} m, '
                f'{by_fixes.y:.2f} m, {by_fixes.yaw:.3f} rad)'
            )
            return True
        if elapsed < SPAN_S:
            return False
        if math.hypot(by_fixes.x, by_fixes.y) > most:  # odometry at zero would have differed
            self._count_agreement()
        return True

    def _count_agreement(self) -> None:
        self._agreements += 1
        if not self.rejected or self._agreements >= AGREEMENTS_AGAIN:
            self.believed = True
            self.detail = ''


def _differences(one: Pose2, other: Pose2) -> tuple[float, float]:
    """Return the distance (m) and the angle (rad) between two motions."""
    return math.hypot(one.x - other.x, one.y - other.y), abs(wrap_angle(one.yaw - other.yaw))
