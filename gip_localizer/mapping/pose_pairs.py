# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Which pairs of mapped frames are compared: of near and far frames, and of repeated passes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.pose import Pose2, wrap_angle

PLACES = 16
"""Number of later frames of pairs, spread evenly over the drive; chosen: some seconds of work."""
SHARES = (0.3, 0.6)
"""Distances to the earlier frames of a place, as shares of the view's length; chosen: at larger
ones too little road is common."""
REVISIT_SHARE = 0.3
"""Largest distance of a frame of another pass, as a share of the view's length; chosen."""
REVISIT_LENGTHS = 4.0
"""Least distance driven in between, in lengths of the view; chosen: no overlap in between."""
MOST_TURN = 0.35
"""Largest angle (rad) between the two headings; chosen: 20 degrees, the views overlap well."""


class Station(NamedTuple):
    """
    A mapped frame.

    Attributes
    ----------
    stamp_ns : int
        Of its image.
    pose : Pose2
        Its given pose in the map frame.

    """

    stamp_ns: int
    pose: Pose2


def driven_distances(stations: Sequence[Station]) -> Floats:
    """Return the distance (n,) driven from the first frame to each, metres."""
    steps = [one.pose.distance(other.pose)
             for one, other in pairwise(stations)]
    return np.concatenate([[0.0], np.cumsum(steps)])


def choose_pairs(stations: Sequence[Station], length: float) -> list[tuple[int, int]]:
    """
    Return indices (earlier, later) of frames that see the same road.

    Parameters
    ----------
    stations : sequence of Station
        Mapped frames in order of time.
    length : float
        Length of the view, metres.

    """
    if len(stations) < 2:
        return []
    driven = driven_distances(stations)
    chosen: set[tuple[int, int]] = set()
    for later in np.unique(np.linspace(1, len(stations) - 1, PLACES).round().astype(int)):
        for share in SHARES:
            gap = np.abs(driven[later] - driven[:later] - share * length)
            earlier = int(np.argmin(gap))
            if gap[earlier] < 0.5 * share * length and _alike(stations[earlier], stations[later]):
                chosen.add((earlier, int(later)))
        if (revisited := _revisited(stations, driven, int(later), length)) is not None:
            chosen.add((revisited, int(later)))
    return sorted(chosen)


def _alike(one: Station, other: Station) -> bool:
    return abs(wrap_angle(one.pose.yaw - other.pose.yaw)) < MOST_TURN


def _revisited(
    stations: Sequence[Station], driven: Floats, later: int, length: float
) -> int | None:
    """Return the nearest frame of an earlier pass over the same road, if there is one."""
    long_ago = driven[later] - driven[:later] > REVISIT_LENGTHS * length
    here = stations[later]
    near = [(here.pose.distance(stations[k].pose), k)
            for k in np.flatnonzero(long_ago).tolist() if _alike(stations[k], here)]
    distance, nearest = min(near, default=(np.inf, 0))
    return nearest if distance < REVISIT_SHARE * length else None
