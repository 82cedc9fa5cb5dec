# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Exact residuals of single candidates, for following a mode.

By the compiled loops; without them by the transforms that score whole windows, too.

"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from functools import lru_cache
from itertools import groupby, product

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.kernels.binding import AVAILABLE, PlaneArray
from gip_localizer.core.match.compiled_scores import Comparison
from gip_localizer.core.match.correlation import correlate
from gip_localizer.core.match.lattice import Index
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.match.scoring import Scorer
from gip_localizer.core.match.template_rotation import turn_affine

# Affine map (no unit) of a template that is already turned; the kernel does not read it.
TURNED = np.zeros((2, 3))
# Largest number of buffers of one shape that are kept (design choice: 32, one per kept mode).
SPARE_BUFFERS = 32
# Largest size (bytes) of a buffer that is kept (design choice: 1 MiB, which bounds the memory to
# 32 MiB).
SPARE_BYTES = 1 << 20


Rectangle = tuple[int, int, int, int]
"""First x and y of some translations, and how many there are in x and in y."""


def _rectangles(places: list[Index]) -> dict[Rectangle, list[int]]:
    """Divide sorted candidates into rectangles, each of one or more yaws."""
    found: dict[Rectangle, list[int]] = {}
    last: tuple[int, Rectangle] | None = None
    # neighbours in y, one after the other, have the same difference
    for _, run in groupby(enumerate(places), lambda n: (n[1][:2], n[0] - n[1][2])):
        (_, (yaw, x, y)), *others = run
        n_x, count = 1, 1 + len(others)
        if last and last[0] == yaw:
            first_x, first_y, high, wide = last[1]
            if (first_x + high, first_y, wide) == (x, y, count):
                found[last[1]].pop()
                x, n_x = first_x, high + 1
        last = yaw, (x, y, n_x, count)
        found.setdefault(last[1], []).append(yaw)
    return {rectangle: yaws for rectangle, yaws in found.items() if yaws}


class _Buffers:
    """Buffers of one shape (templates, rows, cols) that are used again."""

    def __init__(self, shape: tuple[int, int, int]) -> None:
        self._shape = shape
        self._spare: deque[PlaneArray] = deque(maxlen=SPARE_BUFFERS)

    def take(self) -> PlaneArray:
        """Return a buffer that holds anything."""
        try:
            return self._spare.pop()
        except IndexError:
            return PlaneArray(np.empty(self._shape, np.float32))

    def put(self, buffer: PlaneArray) -> None:
        """Take a buffer back."""
        if buffer.array.nbytes <= SPARE_BYTES:
            self._spare.append(buffer)


@lru_cache(maxsize=8)
def _buffers_of(shape: tuple[int, int, int]) -> _Buffers:
    return _Buffers(shape)


class LocalScores:
    """
    Residuals of selected candidates of a level.

    Parameters
    ----------
    level : Level
        View, map window and lattice.
    normalized, min_overlap
        As for `match`.
    about : (int, int, int), optional
        Only the part of the window about this candidate is prepared; `holds` checks whether it
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
            everywhere=level.everywhere,
        )
        templates = self._scorer.templates
        self._comparison = Comparison(
            templates, self._scorer.fields, self._scorer.terms, self._scorer.sums_needed
        ) if AVAILABLE else None
        self._turned: dict[int, PlaneArray] = {}
        self._totals = np.zeros((len(level.lattice.yaws), self._scorer.sums_needed), np.float32)
        self._buffers = _buffers_of((len(templates.planes), *canvas.shape))
        self.known: dict[Index, float] = {}

    def close(self) -> None:
        """Give the arrays back for the next frame; what is known stays."""
        for buffer in self._turned.values():
            self._buffers.put(buffer)
        self._turned = {}

    def holds(self, index: Index) -> bool:
        """Whether a candidate's neighbours up to two steps away can be scored."""
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
        """Whether another scored neighbour of the candidate is about as good."""
        limit = self.known[index] * (1.0 + share)
        return any(place != index and self.known[place] <= limit for place in self.box(index))

    def score(self, places: Iterable[Index]) -> None:
        """Make candidates known."""
        self._score_new(sorted(set(places).difference(self.known)))

    def _score_new(self, new: list[Index]) -> None:
        """Make candidates known that are not, in their order."""
        if not new:
            return
        sums: list[Floats] = []
        places: list[Index] = []
        for (x, y, n_x, n_y), yaws in _rectangles(new).items():
            start = x - self._low[0], y - self._low[1]
            of_yaws = np.empty((len(yaws), len(self._scorer.terms), n_x, n_y), np.float32)
            self._sum_up(yaws, start, of_yaws)
            sums.append(of_yaws.swapaxes(0, 1).reshape(len(self._scorer.terms), -1))
            places.extend(product(yaws, range(x, x + n_x), range(y, y + n_y)))
        totals = self._totals[[place[0] for place in places]]
        found = self._scorer.score(np.concatenate(sums, axis=1), totals)
        self.known.update(zip(places, found.residual.tolist(), strict=True))

    def _sum_up(self, yaws: list[int], start: tuple[int, int], out: Floats) -> None:
        """Write the terms (yaws, terms, n_x, n_y) of neighbours from a place on."""
        turned = [yaw in self._turned for yaw in yaws]
        affines = [TURNED if there else self._affine(yaw)
                   for yaw, there in zip(yaws, turned, strict=True)]
        for yaw, there in zip(yaws, turned, strict=True):
            if not there:
                self._turned[yaw] = self._buffers.take()
        buffers, totals = [self._turned[yaw] for yaw in yaws], self._totals[yaws]
        if self._comparison:
            self._comparison.compare(affines, buffers, turned, totals, start, out)
        else:
            self._by_transforms(affines, buffers, turned, totals, start, out)
        self._totals[yaws] = totals

    def _by_transforms(
        self, affines: list[Floats], buffers: list[PlaneArray], turned: list[bool], totals: Floats,
        start: tuple[int, int], out: Floats,
    ) -> None:
        """Do what `Comparison.compare` does."""
        for k, buffer in enumerate(buffers):
            if not turned[k]:
                totals[k] = self._scorer.templates.turned(
                    buffer.array, affines[k], totals.shape[1]
                )
        rows, cols = self._level.canvas.shape
        (x, y), (n_x, n_y) = start, out.shape[2:]
        met = self._scorer.fields[:, x : x + rows + n_x - 1, y : y + cols + n_y - 1]

        def turn(yaw: int, planes: Floats) -> None:
            planes[...] = buffers[yaw].array

        def sink(yaws: range, terms: Floats) -> None:
            out[yaws.start : yaws.stop] = terms.swapaxes(0, 1)

        correlate(met, self._scorer.terms, len(buffers), canvas=(rows, cols), turn=turn, sink=sink)

    def _affine(self, yaw: int) -> Floats:
        level = self._level
        angle = float(level.lattice.yaws[yaw])
        return turn_affine(level.grid, level.canvas, angle, level.lattice.pivot)
