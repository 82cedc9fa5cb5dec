# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Exact residuals of single candidates, for following a mode.

A turned template laid out with the row length of a part of the window meets that part at any
translation as one contiguous run, so that without the compiled loop a sum of products is one
product of long vectors.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby, product

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.compiled import AVAILABLE
from gip_localizer.core.correlation import as_pairs, Term
from gip_localizer.core.few_sums import correlate_few, Stack
from gip_localizer.core.field_level import Level
from gip_localizer.core.scoring import Scorer
from gip_localizer.core.turning import turn_affine

Index = tuple[int, int, int]
"""Of yaw, x and y in a lattice."""

SPARE_ROOMS = 32
SPARE_BYTES = 1 << 20  # of each, at most


@dataclass(frozen=True)
class _Block:
    """Candidates of one yaw, in the order of a (n_x, n_y) array from a place on."""

    place: Index
    n_x: int
    n_y: int


def _blocks(places: list[Index]) -> Iterator[_Block]:
    """Divide sorted candidates into blocks."""
    last: _Block | None = None
    # neighbours in y, one after the other, have the same difference
    for _, run in groupby(enumerate(places), lambda n: (n[1][:2], n[0] - n[1][2])):
        (_, place), *others = run
        count = 1 + len(others)
        if last and place == (last.place[0], last.place[1] + last.n_x, last.place[2]) and (
            count == last.n_y
        ):
            last = _Block(last.place, last.n_x + 1, count)
            continue
        if last:
            yield last
        last = _Block(place, 1, count)
    if last:
        yield last


class _Room:
    """
    Room for the templates of one yaw, turned, with rows as long as the window's.

    Attributes
    ----------
    rows : (templates, rows, window cols) float32
        0 beyond the canvas.
    turned : (templates, rows, cols) float32
        The part of it that is on the canvas.
    stack : Stack or None
        The same for the compiled loop.

    """

    def __init__(self, shape: tuple[int, int, int], cols: int) -> None:
        self.rows = np.zeros(shape, np.float32)
        self.turned = self.rows[:, :, :cols]
        self.stack = Stack(self.turned) if AVAILABLE else None


class _Rooms:
    """Rooms of one shape that are used again."""

    def __init__(self, shape: tuple[int, int, int], cols: int) -> None:
        self._shape, self._cols = shape, cols
        self._spare: deque[_Room] = deque(maxlen=SPARE_ROOMS)

    def take(self) -> _Room:
        """Return a room that holds anything on the canvas."""
        try:
            return self._spare.pop()
        except IndexError:
            return _Room(self._shape, self._cols)

    def put(self, room: _Room) -> None:
        """Take a room back."""
        if room.rows.nbytes <= SPARE_BYTES:
            self._spare.append(room)


@lru_cache(maxsize=8)
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
        self._width = self._scorer.fields.shape[2]
        self._fields = self._scorer.fields.reshape(len(self._scorer.fields), -1)
        self._stack = Stack(self._scorer.fields) if AVAILABLE else None
        self._turned: dict[int, _Room] = {}
        self._sums = np.zeros((len(level.lattice.yaws), 2), np.float32)
        templates = len(self._scorer.templates.planes)
        self._rooms = _rooms_of((templates, canvas.rows, self._width), canvas.cols)
        self.known: dict[Index, float] = {}

    def close(self) -> None:
        """Give the arrays back for the next frame; what is known stays."""
        for room in self._turned.values():
            self._rooms.put(room)
        self._turned = {}

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
        self._score_new([place for place in box if place not in self.known])
        return min(box, key=self.known.__getitem__)

    def is_shallow(self, index: Index, share: float) -> bool:
        """Tell whether another of the candidate's scored neighbours is about as good."""
        limit = self.known[index] * (1.0 + share)
        return any(place != index and self.known[place] <= limit for place in self.box(index))

    def score(self, places: Iterable[Index]) -> None:
        """Make candidates known."""
        self._score_new(sorted(set(places).difference(self.known)))

    def _score_new(self, new: list[Index]) -> None:
        """Make candidates known that are not, in their order."""
        if not new:
            return
        sums = np.empty((len(self._scorer.terms), len(new)), np.float32)
        first = 0
        for block in _blocks(new):
            size = block.n_x * block.n_y
            for term, row in zip(self._scorer.terms, sums, strict=True):
                out = row[first : first + size].reshape(block.n_x, block.n_y)
                self._correlate(block.place, term, out)
            first += size
        turned = self._sums[[place[0] for place in new]]
        residual = self._scorer.score(sums, turned).residual
        self.known.update(zip(new, residual.tolist(), strict=True))

    def _correlate(self, place: Index, term: Term, out: Floats) -> None:
        """Write a term (n_x, n_y) of the neighbours from a place on."""
        yaw, x, y = place[0], place[1] - self._low[0], place[2] - self._low[1]
        room = self._turned.get(yaw) or self._turn(yaw)
        if room.stack and self._stack:
            correlate_few(room.stack, self._stack, as_pairs(term), (x, y), out)
            return
        rows, cols = self._level.canvas.shape
        length = (rows - 1) * self._width + cols
        runs = room.rows.reshape(len(room.rows), -1)[:, :length]
        for k, row in enumerate(out):
            first = (x + k) * self._width + y
            parts = self._fields[:, first : first + length + len(row) - 1]
            row[:] = sum(np.correlate(parts[field], runs[t]) for t, field in term)

    def _turn(self, yaw: int) -> _Room:
        """Turn the templates; keep them and their sums."""
        room = self._turned[yaw] = self._rooms.take()
        self._scorer.templates.turn_into(room.turned, self._affine(yaw))
        for template in range(self._scorer.sums_needed):
            self._sums[yaw, template] = cv2.sumElems(room.turned[template])[0]
        return room

    def _affine(self, yaw: int) -> Floats:
        level = self._level
        angle = float(level.lattice.yaws[yaw])
        return turn_affine(level.grid, level.canvas, angle, level.lattice.pivot)
