# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Exact residuals of single candidates, for following a mode.

A turned template laid out with the window's row length meets the window of any translation as
one contiguous run, so that a candidate is a product of two short, long matrices.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from functools import lru_cache

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.field_level import Level
from gip_localizer.core.lattice import turn_affine, turn_into
from gip_localizer.core.scoring import Scorer
from gip_localizer.core.threads import in_parallel

Index = tuple[int, int, int]
"""Of yaw, x and y in a lattice."""

WORTH_A_THREAD = 20_000  # cells, below which threads wait more than they work
SPARE_ROOMS = 16
SPARE_BYTES = 1 << 20  # of each, at most
BOX = tuple((k, i, j) for k in (-1, 0, 1) for i in (-1, 0, 1) for j in (-1, 0, 1))


class _Rooms:
    """Arrays of one shape that are used again, zero beyond some columns."""

    def __init__(self, shape: tuple[int, int, int], cols: int) -> None:
        self._shape, self._cols = shape, cols
        self._spare: deque[Floats] = deque(maxlen=SPARE_ROOMS)

    def take(self) -> Floats:
        """Return an array whose first columns hold anything."""
        try:
            return self._spare.pop()
        except IndexError:
            room = np.empty(self._shape, np.float32)
            room[:, :, self._cols :] = 0.0
            return room

    def put(self, room: Floats) -> None:
        """Take an array back."""
        if room.nbytes <= SPARE_BYTES:
            self._spare.append(room)


@lru_cache(maxsize=4)
def _rooms_of(shape: tuple[int, int, int], cols: int) -> _Rooms:
    return _Rooms(shape, cols)


class Probe:
    """
    Residuals of chosen candidates of a level.

    Parameters
    ----------
    level : Level
        View, map window and lattice.
    normalized, min_overlap
        As for `match`.

    Attributes
    ----------
    known : dict
        Index to residual, for every candidate scored so far.

    """

    def __init__(self, level: Level, *, normalized: bool, min_overlap: float) -> None:
        self._level = level
        self._scorer = Scorer(
            level.values, level.weight, level.window, level.known,
            normalized=normalized, min_overlap=min_overlap, residual_only=True,
        )
        self._width = level.window.shape[1]
        self._fields = self._scorer.fields.reshape(len(self._scorer.fields), -1)
        self._turned: dict[int, tuple[Floats, tuple[float, float]]] = {}
        self._rooms = _rooms_of(
            (len(self._scorer.templates), level.canvas.rows, self._width), level.canvas.cols
        )
        self.known: dict[Index, float] = {}

    def close(self) -> None:
        """Give the arrays back for the next frame; what is known stays."""
        for flat, _ in self._turned.values():
            self._rooms.put(flat)
        self._turned = {}

    def box(self, index: Index, reach: int = 1) -> list[Index]:
        """Return a candidate and its neighbours inside the lattice, `reach` steps away."""
        n_yaw, n_x, n_y = self._level.lattice.shape
        around = (
            (index[0] + k * reach, index[1] + i * reach, index[2] + j * reach) for k, i, j in BOX
        )
        return [
            (yaw, x, y) for yaw, x, y in around
            if 0 <= yaw < n_yaw and 0 <= x < n_x and 0 <= y < n_y
        ]

    def best_about(self, index: Index, reach: int = 1) -> Index:
        """Return the best of a candidate and its neighbours, scored where they are not."""
        box = self.box(index, reach)
        self.score(box)
        return min(box, key=self.known.__getitem__)

    def is_shallow(self, index: Index, share: float) -> bool:
        """Tell whether another of the candidate's scored neighbours is about as good."""
        least = self.known[index]
        limit = least * (1.0 + share)
        return any(place != index and self.known[place] <= limit for place in self.box(index))

    def score(self, places: Iterable[Index]) -> None:
        """Make these candidates known."""
        by_yaw: dict[int, list[Index]] = {}
        for place in dict.fromkeys(places):
            if place not in self.known:
                by_yaw.setdefault(place[0], []).append(place)

        parts = list(by_yaw.values())
        if self._level.canvas.rows * self._width >= WORTH_A_THREAD:
            in_parallel(self._score_yaw, parts)
        else:
            for part in parts:
                self._score_yaw(part)

    def _score_yaw(self, places: list[Index]) -> None:
        """Score candidates of one yaw."""
        room, turned = self._templates(places[0][0])
        length = (room.shape[1] - 1) * self._width + self._level.canvas.cols
        templates = room.reshape(len(room), -1)[:, :length]
        sums = np.empty((len(templates), len(self._fields), len(places)), np.float32)
        for n, (_, x, y) in enumerate(places):
            start = x * self._width + y
            sums[:, :, n] = templates @ self._fields[:, start : start + length].T
        terms = np.empty((len(self._scorer.terms), len(places)), np.float32)
        for total, term in zip(terms, self._scorer.terms, strict=True):
            total[:] = sums[term[0]]
            for pair in term[1:]:
                total += sums[pair]
        residual = self._scorer.score(terms, turned).residual
        self.known.update(zip(places, residual.tolist(), strict=True))

    def _templates(self, yaw: int) -> tuple[Floats, tuple[float, float]]:
        """Turned templates (n, rows, window's cols), zero beyond the canvas, and their sums."""
        if yaw not in self._turned:
            level, canvas = self._level, self._level.canvas
            room = self._rooms.take()
            inner = room[:, :, : canvas.cols]
            affine = turn_affine(
                level.grid, canvas, float(level.lattice.yaws[yaw]), level.lattice.pivot
            )
            for plane, template in zip(inner, self._scorer.templates, strict=True):
                turn_into(plane, template, affine)
            self._turned[yaw] = room, self._scorer.turned_sums(inner)
        return self._turned[yaw]
