# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Motion between image stamps, from odometry that may be late, sparse or wrong."""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
import math

from gip_localizer.core.pose import interpolate, Pose2
from gip_localizer.core.track.stamp_check import REWIND_NS
from gip_localizer.parameters import Motion

# Age (ns), relative to the newest sample, above which samples are dropped (design choice: 20 s,
# because a search of the whole map delays an image by less).
KEPT_NS = 20_000_000_000
# Largest yaw rate (rad/s) that is accepted (design choice: 50 rad/s, because robots that turn on
# the spot reach a fifth of it).
MAX_TURN = 50.0
# Forward step of the stamps (s) above which the next sample must confirm the new time, as after a
# backward step of REWIND_NS (design choice: 20 s, because a working driver pauses for less).
LEAP_S = 20.0


@dataclass(frozen=True)
class OdometrySample:
    """
    One odometry message.

    Attributes
    ----------
    stamp_ns : int
        Nanoseconds.
    pose : Pose2
        Pose of base in odom.
    forward, left : float
        Velocity along the base axes, m/s.
    turn : float
        Yaw rate, rad/s.

    """

    stamp_ns: int
    pose: Pose2
    forward: float = 0.0
    left: float = 0.0
    turn: float = 0.0


@dataclass
class OdometryBuffer:
    """
    Recent odometry, ordered by stamp, and the reason why the last sample was refused.

    Attributes
    ----------
    limits : Motion
        Largest gap between samples and largest speed.
    refusal : str
        Why the last sample was refused; empty after an accepted sample.
    refused : int
        Samples refused so far.

    """

    limits: Motion
    refusal: str = ''
    refused: int = 0
    _unconfirmed: OdometrySample | None = None
    _samples: list[OdometrySample] = field(default_factory=list)

    @property
    def latest(self) -> OdometrySample | None:
        """The newest sample."""
        return self._samples[-1] if self._samples else None

    def clear(self) -> None:
        """Drop all samples."""
        self._samples.clear()
        self._unconfirmed = None

    def add(self, sample: OdometrySample) -> bool:
        """Add a sample; return False if it is refused (see `refusal`)."""
        self.refusal = self._fault(sample)
        if self.refusal:
            self.refused += 1
            return False
        self._samples.append(sample)
        oldest = sample.stamp_ns - KEPT_NS
        if len(self._samples) > 16 and self._samples[8].stamp_ns < oldest:
            del self._samples[:8]
        return True

    def _fault(self, sample: OdometrySample) -> str:
        numbers = (*sample.pose, sample.forward, sample.left, sample.turn)
        if not all(math.isfinite(value) for value in numbers):
            return 'odometry holds NaN or infinity'
        speed = math.hypot(sample.forward, sample.left)
        if speed > self.limits.max_speed or abs(sample.turn) > MAX_TURN:
            return (
                f'odometry reports {speed:.3g} m/s and {sample.turn:.3g} rad/s; expected at most '
                f'motion.max_speed {self.limits.max_speed:g} m/s and {MAX_TURN:g} rad/s'
            )
        if self.latest is None:
            return ''
        ahead = (sample.stamp_ns - self.latest.stamp_ns) * 1e-9
        if not -REWIND_NS * 1e-9 <= ahead <= LEAP_S:
            if not self._confirms_time(sample):
                return (
                    f'odometry stamp jumps by {ahead:+.3f} s; the new time is used if the next '
                    'message confirms it'
                )
        elif ahead == 0.0:
            return 'odometry repeats the stamp of the last message'
        elif ahead < 0.0:
            return f'odometry stamp is {-ahead:.3f} s before the last message'
        self._unconfirmed = None
        return self._jump(sample, self.latest)

    def _jump(self, sample: OdometrySample, last: OdometrySample) -> str:
        elapsed = (sample.stamp_ns - last.stamp_ns) * 1e-9
        moved = last.pose.distance(sample.pose)
        if moved / elapsed > self.limits.max_speed and moved > 0.1:
            self.clear()
            self._samples.append(sample)
            return f'odometry jumped {moved:.2f} m in {elapsed:.3f} s'
        return ''

    def _confirms_time(self, sample: OdometrySample) -> bool:
        """Return whether a sample confirms a jump in time; earlier samples are then dropped."""
        jumped, self._unconfirmed = self._unconfirmed, sample
        if jumped is None or not 0 < sample.stamp_ns - jumped.stamp_ns <= LEAP_S * 1e9:
            return False
        self._samples = [jumped]
        return True

    def newest_ahead(self, stamp_ns: int) -> float | None:
        """Return the seconds from a stamp to the newest sample; None without samples."""
        last = self._unconfirmed or self.latest
        return None if last is None else (last.stamp_ns - stamp_ns) * 1e-9

    def motion(self, start_ns: int, end_ns: int) -> Pose2 | None:
        """
        Motion of base from one stamp to another, in base axes at the start.

        Returns
        -------
        Pose2 or None
            None where the samples do not reach both stamps within `motion.max_gap`.

        """
        start, end = self.pose_at(start_ns), self.pose_at(end_ns)
        if start is None or end is None:
            return None
        return start.inverse() @ end

    def pose_at(self, stamp_ns: int) -> Pose2 | None:
        """Base in odom at a stamp; None where no sample is within `motion.max_gap`."""
        after = bisect_right(self._samples, stamp_ns, key=lambda s: s.stamp_ns)
        gap_ns = int(self.limits.max_gap * 1e9)
        if after == 0:
            return None
        before = self._samples[after - 1]
        ahead = (stamp_ns - before.stamp_ns) * 1e-9
        if after < len(self._samples):
            following = self._samples[after]
            whole = following.stamp_ns - before.stamp_ns
            if whole > gap_ns:
                return None
            return interpolate(before.pose, following.pose, ahead * 1e9 / whole)
        if stamp_ns - before.stamp_ns > gap_ns:
            return None
        turned = before.turn * ahead
        halfway = Pose2(0.0, 0.0, 0.5 * turned)
        step = Pose2(before.forward * ahead, before.left * ahead, 0.5 * turned)
        return before.pose @ halfway @ step
