# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Whether odometry is used: its motion compared with the motion between fixes.

Odometry that stays at zero, comes from another vehicle or has other units is well-formed; only the
matches show that it is wrong. It is therefore used after it has agreed with the fixes over a
motion that is long enough to show an error, and rejected at the first contradiction. Until then
the velocity of the fixes is used instead.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.core.pose import Pose2, wrap_angle

# Difference of two motions (m, rad) that is allowed in addition to their uncertainty (design
# choice: 0.1 m, because stamps of odometry and images differ by milliseconds, and 0.02 rad).
SLACK_XY, SLACK_YAW = 0.1, 0.02
# Number of standard deviations by which two motions may differ: 99.7 % of a normal distribution.
SIGMAS = 3.0
# Least time (s) over which an agreement counts (design choice: 1 s, because small errors of the
# velocity add up to more than the slack within it).
SPAN_S = 1.0
# Number of consecutive agreements before rejected odometry is used again (design choice: 3,
# because a single agreement after a contradiction may be by chance).
AGREEMENTS_AGAIN = 3
# Largest accelerations of a road vehicle (m/s², rad/s²; design choice: 20 m/s², because tyres
# transmit at most half of it, and 10 rad/s²).
MAX_ACCELERATION, MAX_TURN_ACCELERATION = 20.0, 10.0


@dataclass
class OdometryCheck:
    """
    Compares the motion by odometry with the motion between fixes.

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
            Motion by odometry, m and rad.
        extrapolated : Pose2 or None
            Motion by the velocity of the last fixes; None without a velocity.
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
                f'odometry reports a motion of {_text(measured)} in {elapsed:.2f} s, the matches '
                f'{_text(by_fixes)}'
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


def _text(motion: Pose2) -> str:
    return f'({motion.x:.2f} m, {motion.y:.2f} m, {motion.yaw:.3f} rad)'


def _differences(one: Pose2, other: Pose2) -> tuple[float, float]:
    """Return the distance (m) and the angle (rad) between two motions."""
    return math.hypot(one.x - other.x, one.y - other.y), abs(wrap_angle(one.yaw - other.yaw))
