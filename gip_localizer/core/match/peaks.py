# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Peaks of score surfaces, and the modes among scored candidates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Floats
from gip_localizer.core.match.lattice import Index

Peak = tuple[float, float, float]
"""Index of a mode, between candidates."""
Mode = tuple[float, Peak]
"""Its residual, and where it is."""

# Least distance of two peaks (steps in yaw, x and y; design choice: 2, 3 and 3, because nearer
# peaks belong to one mode).
PEAK_GAP = (2, 3, 3)


def best_peaks(values: Floats, count: int) -> list[tuple[int, int, int]]:
    """Return indices (yaw, x, y) of the largest finite values that are `PEAK_GAP` apart."""
    left = values.copy()
    chosen: list[tuple[int, int, int]] = []
    for _ in range(count):
        yaw, x, y = (int(i) for i in np.unravel_index(int(left.argmax()), left.shape))
        if not np.isfinite(left[yaw, x, y]):
            break
        chosen.append((yaw, x, y))
        around = zip((yaw, x, y), PEAK_GAP, strict=True)
        left[tuple(slice(max(i - gap, 0), i + gap + 1) for i, gap in around)] = -np.inf
    return chosen


def vertex(low: float, middle: float, high: float) -> tuple[float, float]:
    """
    Return where the parabola through three values, one step apart, is least, and its bend.

    The place is relative to the middle, at most half a step away. Where the parabola has no
    minimum, or a value is infinite, both are 0.

    """
    bend = low - 2.0 * middle + high
    if not 0.0 < bend < np.inf:
        return 0.0, 0.0
    return min(max(0.5 * (low - high) / bend, -0.5), 0.5), bend


class ResidualLookup:
    """Residuals by index, as in a dictionary."""

    def __init__(self, residual: Floats) -> None:
        self._residual = residual

    def __getitem__(self, place: Index) -> float:
        return self._residual.item(place)

    def get(self, place: Index, default: float) -> float:
        """Return a residual, or the default outside the lattice."""
        if min(place) < 0:
            return default
        try:
            return self._residual.item(place)
        except IndexError:
            return default


def modes_of(
    places: NDArray[np.int64], values: ResidualLookup | dict[Index, float], count: int
) -> list[Mode]:
    """
    Return those of the places, best first, that have no better neighbour: at most `count`.

    Each at the minimum of the parabolas through its neighbours, in the order of these minima.

    """
    apart = [np.abs(index[:, None] - index) > 1 for index in places.T]
    near_a_better = np.tri(len(places), k=-1, dtype=bool) & ~(apart[0] | apart[1] | apart[2])
    alone = ~near_a_better.any(axis=1)
    best: list[Index] = list(map(tuple, places[alone][:count].tolist()))  # type: ignore[arg-type]
    return sorted(_between(values, place) for place in best)


def _between(values: ResidualLookup | dict[Index, float], place: Index) -> Mode:
    """Return the least of a parabola on each axis, and where it is, within half a step."""
    peak = [float(n) for n in place]
    least = middle = values[place]
    for axis in range(3):
        low, high = (
            values.get((place[0] + s * (axis == 0), place[1] + s * (axis == 1),
                        place[2] + s * (axis == 2)), np.inf) for s in (-1, 1)
        )
        shift, bend = vertex(low, middle, high)
        peak[axis] += shift
        least -= 0.5 * bend * shift * shift
    return least, (peak[0], peak[1], peak[2])
