# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Exact residuals of single candidates, for following a mode.

A turned template laid out with the row length of a part of the window meets that part at any
translation as one contiguous run, so that a sum of products is one product of long vectors.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from functools import lru_cache
from itertools import groupby, product

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.field_level import Level
from gip_localizer.core.lattice import turn_affine, turn_into
from gip_localizer.core.scoring import Scorer

Index = tuple[int, int, int]
"""Of yaw, x and y in a lattice."""

SPARE_ROOMS = 32
SPARE_BYTES = 1 << 19  # of each, at most


class _Rooms:
    """Arrays of one shape that are used again, zero beyond some columns."""

    def __init__(self, shape: tuple[int, int], cols: int) -> None:
        self._shape, self._cols = shape, cols
        self._spare: deque[Floats] = deque(maxlen=SPARE_ROOMS)

    def take(self) -> Floats:
        """Return an array whose first columns hold anything."""
        try:
            return self._spare.pop()
        except IndexError:
            room = np.empty(self._shape, np.float32)
            room[:, self._cols :] = 0.0
            return room

    def put(self, room: Floats) -> None:
        """Take an array back."""
        if room.nbytes <= SPARE_BYTES:
            self._spare.append(room)


@lru_cache(maxsize=8)
def _rooms_of(shape: tuple[int, int], cols: int) -> _Rooms:
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
    about : (int, int, int), optional
        Only the part of the window about this candidate is prepared; `holds` tells whether it
        is enough.
    reach : int
        Translations about it that may be scored.

    Attributes
    ----------
    known : dict
        Index to residual, for every candidate scored so far.

    """

    def __init__(
        self, level: Level, *, normalized: bool, min_overlap: float, about: Index | None = None,
        reach: int = 0,
    ) -> None:
        self._level = level
        half, canvas = level.lattice.half, level.canvas
        centre = about[1:] if about else half
        x, y = ((max(n - reach, 0), min(n + reach, 2 * h)) if about else (0, 2 * h)
                for n, h in zip(centre, half, strict=True))
        self._low, self._high = (x[0], y[0]), (x[1], y[1])
        part = slice(x[0], x[1] + canvas.rows), slice(y[0], y[1] + canvas.cols)
        self._scorer = Scorer(
            level.values, level.weight, level.window[part], level.known[part],
            normalized=normalized, min_overlap=min_overlap, residual_only=True,
        )
        self._pairs = sorted({pair for term in self._scorer.terms for pair in term})
        self._width = self._scorer.fields.shape[2]
        self._fields = self._scorer.fields.reshape(len(self._scorer.fields), -1)
        self._turned: dict[tuple[int, int], Floats] = {}
        self._taken: list[Floats] = []
        self._sums = np.zeros((len(level.lattice.yaws), 2), np.float32)
        self._rooms = _rooms_of((canvas.rows, self._width), canvas.cols)
        self.known: dict[Index, float] = {}

    def close(self) -> None:
        """Give the arrays back for the next frame; what is known stays."""
        for room in self._taken:
            self._rooms.put(room)
        self._taken, self._turned = [], {}

    def holds(self, index: Index) -> bool:
        """Tell whether a candidate's neighbours may be asked for, two steps away at most."""
        half = self._level.lattice.half
        return all(
            (low == 0 or n - 2 >= low) and (high == 2 * h or n + 2 <= high) for n, low, high, h
            in zip(index[1:], self._low, self._high, half, strict=True)
        )

    def box(self, index: Index, reach: int = 1) -> list[Index]:
        """Return a candidate and its neighbours inside the lattice, `reach` steps away."""
        yaws, xs, ys = (
            [k for k in (n - reach, n, n + reach) if 0 <= k < count]
            for n, count in zip(index, self._level.lattice.shape, strict=True)
        )
        return list(product(yaws, xs, ys))

    def best_about(self, index: Index, reach: int = 1) -> Index:
        """Return the best of a candidate and its neighbours, scored where they are not."""
        box = self.box(index, reach)
        self.score(box)
        return min(box, key=self.known.__getitem__)

    def is_shallow(self, index: Index, share: float) -> bool:
        """Tell whether another of the candidate's scored neighbours is about as good."""
        limit = self.known[index] * (1.0 + share)
        return any(place != index and self.known[place] <= limit for place in self.box(index))

    def score(self, places: Iterable[Index]) -> None:
        """Make candidates known."""
        new = sorted(set(places).difference(self.known))
        if not new:
            return
        sums = np.empty((len(self._pairs), len(new)), np.float32)
        # neighbours in y, one after the other, have the same difference
        for _, run in groupby(enumerate(new), lambda n: (n[1][:2], n[0] - n[1][2])):
            (first, place), *others = run
            self._sum_up(place, 1 + len(others), sums[:, first : first + len(others) + 1])
        turned = self._sums[[place[0] for place in new]]
        residual = self._scorer.score(self._terms(sums), turned).residual
        self.known.update(zip(new, residual.tolist(), strict=True))

    def _terms(self, sums: Floats) -> Floats:
        row = {pair: n for n, pair in enumerate(self._pairs)}
        return np.stack([
            sums[[row[pair] for pair in term]].sum(axis=0) for term in self._scorer.terms
        ])

    def _sum_up(self, place: Index, count: int, sums: Floats) -> None:
        """Write the sums (pairs, count) of so many candidates, the next in y after each other."""
        yaw, x, y = place
        start = (x - self._low[0]) * self._width + y - self._low[1]
        for row, (template, field) in zip(sums, self._pairs, strict=True):
            turned = self._turned.get((yaw, template))
            if turned is None:
                turned = self._turn(yaw, template)
            part = self._fields[field, start : start + len(turned) + count - 1]
            row[:] = np.correlate(part, turned)

    def _turn(self, yaw: int, template: int) -> Floats:
        """Turn a template, row by row and zero beyond the canvas; keep it and its sum."""
        canvas = self._level.canvas
        room = self._rooms.take()
        self._taken.append(room)
        turn_into(room[:, : canvas.cols], self._scorer.templates[template], self._affine(yaw))
        if self._scorer.sums_needed(template):
            self._sums[yaw, template] = cv2.sumElems(room)[0]
        length = (canvas.rows - 1) * self._width + canvas.cols
        turned: Floats = room.reshape(-1)[:length]
        self._turned[yaw, template] = turned
        return turned

    def _affine(self, yaw: int) -> Floats:
        level = self._level
        angle = float(level.lattice.yaws[yaw])
        return turn_affine(level.grid, level.canvas, angle, level.lattice.pivot)
