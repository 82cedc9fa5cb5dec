# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Trajectories: stamped planar poses."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.pose import Pose2

Floats = NDArray[np.float64]
Stamps = NDArray[np.int64]
MAX_GAP_NS = 2_000_000_000
"""Longest gap (ns) between two poses of the ground truth for interpolation; chosen."""


@dataclass(frozen=True, eq=False)
class Trajectory:
    """
    Stamped poses, in order of time.

    Attributes
    ----------
    stamps_ns : (n,) int64
        Strictly increasing, nanoseconds.
    poses : (n, 3) float64
        x, y in metres, yaw in radians, map frame.

    """

    stamps_ns: Stamps
    poses: Floats

    def __len__(self) -> int:
        """Return the number of poses."""
        return len(self.stamps_ns)

    @classmethod
    def from_samples(cls, samples: Iterable[tuple[int, Pose2]]) -> Trajectory:
        """Sort samples by stamp; of several with one stamp the last is kept."""
        latest = dict(samples)
        stamps = np.array(sorted(latest), np.int64)
        poses = np.array([latest[int(stamp)] for stamp in stamps], np.float64).reshape(-1, 3)
        return cls(stamps, poses)

    def at(self, stamps_ns: Stamps, max_gap_ns: int = MAX_GAP_NS) -> Floats:
        """
        Interpolate at other stamps: linear in x and y, the shortest way in yaw.

        Parameters
        ----------
        stamps_ns : (m,) int64
            Stamps of the requested poses, nanoseconds, in any order.
        max_gap_ns : int
            Longest time between two neighbours for interpolation, nanoseconds.

        Returns
        -------
        (m, 3) float64
            x, y, yaw; NaN before the first pose, after the last, and within a longer gap.

        """
        wanted = np.asarray(stamps_ns, np.int64)
        result = np.full((len(wanted), 3), np.nan)
        if len(self) == 0 or len(wanted) == 0:
            return result
        after = np.searchsorted(self.stamps_ns, wanted, side='left')
        inside = after < len(self)
        exact = inside & (self.stamps_ns[np.minimum(after, len(self) - 1)] == wanted)
        result[exact] = self.poses[after[exact]]
        between = inside & ~exact & (after > 0)
        result[between] = self._between(wanted[between], after[between], max_gap_ns)
        return result

    def with_stamps(self, stamps_ns: Stamps) -> Trajectory:
        """
        Add the interpolated poses at other stamps, where they are known; its own poses stay.

        Parameters
        ----------
        stamps_ns : (m,) int64
            Nanoseconds, in any order.

        Returns
        -------
        Trajectory
            The same path, for tools that look up the nearest stamp instead of interpolating.

        """
        wanted = np.asarray(stamps_ns, np.int64)
        poses = self.at(wanted)
        known = np.isfinite(poses).all(axis=1)
        stamps, first = np.unique(
            np.concatenate([self.stamps_ns, wanted[known]]), return_index=True
        )
        return Trajectory(stamps, np.concatenate([self.poses, poses[known]])[first])

    def _between(self, wanted: Stamps, after: NDArray[np.intp], max_gap_ns: int) -> Floats:
        start, end = self.stamps_ns[after - 1], self.stamps_ns[after]
        fraction = ((wanted - start) / (end - start))[:, None]
        first, last = self.poses[after - 1], self.poses[after]
        step = last - first
        step[:, 2] = (step[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
        poses = np.asarray(first + fraction * step, np.float64)
        poses[:, 2] = (poses[:, 2] + math.pi) % (2.0 * math.pi) - math.pi
        poses[end - start > max_gap_ns] = np.nan
        return poses


def stamp_text(stamp_ns: int) -> str:
    """Return a stamp as seconds with nine decimals, exactly."""
    sign = '-' if stamp_ns < 0 else ''
    whole, rest = divmod(abs(stamp_ns), 1_000_000_000)
    return f'{sign}{whole}.{rest:09d}'
