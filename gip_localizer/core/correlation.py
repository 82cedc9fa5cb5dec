# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Sums of products of turned templates and map fields, over all translations.

A term is `S[d] = Σ_pairs Σ_i T_p[i] F_p[i + d]`. Few translations are done as one matrix product
per map row over all yaws, many by transforms: the fields' spectra serve all yaws, and the pairs
of a term are added up as spectra, so that each term costs one inverse.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import threading

import numpy as np
from numpy.lib.stride_tricks import as_strided, sliding_window_view

from gip_localizer.core.arrays import Floats
from gip_localizer.core.spectra import make_transform, Spectrum, Transform
from gip_localizer.core.threads import in_parallel, shares

Term = tuple[tuple[int, int], ...]
"""Pairs of template and field (indices), whose correlations are added."""
Turn = Callable[[int, Floats], None]
"""Writes the templates (n, rows, cols) of a yaw (index)."""
Sink = Callable[[int, Floats], None]
"""Takes a yaw (index) and its terms (n_terms, n_x, n_y), valid during the call only."""

PRODUCT_CANDIDATES = 200  # translations up to which matrix products beat transforms
PRODUCT_YAWS = 32  # at once, which bounds the memory
KEPT_BYTES = 1 << 23  # of an array, above which it is not kept between frames
WORTH_A_THREAD = 150_000  # cells to turn, below which threads wait more than they work


def correlate(
    fields: Floats, terms: Sequence[Term], yaws: int, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """
    Give the terms of every yaw to the sink, from several threads, in any order.

    Parameters
    ----------
    fields : (n_fields, rows, cols) float32
        Map fields on the window.
    terms : sequence of Term
        What to sum.
    yaws : int
        Number of yaws.
    canvas : (int, int)
        Rows and columns of the turned templates; the translations are what the window has more.
    turn, sink : callable
        Where templates come from and where sums go.

    """
    n_x, n_y = (1 + fields.shape[k + 1] - canvas[k] for k in (0, 1))
    if n_x * n_y <= PRODUCT_CANDIDATES:
        for start in range(0, yaws, PRODUCT_YAWS):
            batch = range(start, min(start + PRODUCT_YAWS, yaws))
            by_products(fields, terms, batch, canvas=canvas, turn=turn, sink=sink)
    else:
        by_transforms(fields, terms, yaws, canvas=canvas, turn=turn, sink=sink)


def by_transforms(
    fields: Floats, terms: Sequence[Term], yaws: int, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """Correlate as `correlate` does, with transforms, yaw by yaw."""
    rows, cols = fields.shape[1:]
    transform = make_transform(rows, cols)
    plane = np.zeros(transform.shape, np.float32)
    spectra = []
    for field in fields:
        plane[:rows, :cols] = field
        spectra.append(transform.forward(plane, rows, transform.empty()))
    count = 1 + max(t for term in terms for t, _ in term)
    size = (1 + rows - canvas[0], 1 + cols - canvas[1])

    def work(share: range) -> None:
        desk = _desk(transform, count, len(terms), size, canvas)
        for yaw in share:
            turn(yaw, desk.planes[:, : canvas[0], : canvas[1]])
            sink(yaw, desk.terms(spectra, terms, canvas[0]))

    in_parallel(work, shares(yaws))


class _Desk:
    """The arrays that one thread works in."""

    def __init__(
        self, transform: Transform, templates: int, terms: int, size: tuple[int, int]
    ) -> None:
        self._transform = transform
        self._size = size
        self.planes = np.zeros((templates, *transform.shape), np.float32)
        self._spectra = [transform.empty() for _ in range(templates)]
        self._product, self._sum = transform.empty(), transform.empty()
        self._back = np.empty(transform.shape, np.float32)
        self._out = np.empty((terms, *size), np.float32)

    def terms(self, fields: list[Spectrum], terms: Sequence[Term], rows: int) -> Floats:
        t = self._transform
        turned = [t.forward(p, rows, s) for p, s in zip(self.planes, self._spectra, strict=True)]
        for k, term in enumerate(terms):
            total: Spectrum | None = None
            for template, field in term:
                if total is None:
                    total = t.correlated(fields[field], turned[template], self._sum)
                else:
                    total += t.correlated(fields[field], turned[template], self._product)
            assert total is not None
            self._out[k] = t.inverse(total, self._size, self._back)
        return self._out


_kept = threading.local()


def _desk(transform: Transform, templates: int, terms: int, size: tuple[int, int],
          canvas: tuple[int, int]) -> _Desk:
    """Return this thread's desk of the last frame if it fits, for no room is found faster."""
    key = (type(transform), transform.shape, templates, terms, size, canvas)
    if getattr(_kept, 'key', None) == key:
        desk: _Desk = _kept.desk
        return desk
    _kept.key = _kept.desk = None
    desk = _Desk(transform, templates, terms, size)
    if desk.planes.nbytes <= KEPT_BYTES:
        _kept.key, _kept.desk = key, desk
    return desk


def by_products(
    fields: Floats, terms: Sequence[Term], yaws: range, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """
    Correlate as `correlate` does, with matrix products.

    A map row k meets the template rows k - n_x + 1 … k of all yaws: with these as the rows of one
    matrix and the row's shifted copies as the other, the products add up over k to the sums.

    """
    rows, cols = canvas
    n_x, n_y = 1 + fields.shape[1] - rows, 1 + fields.shape[2] - cols
    count = 1 + max(t for term in terms for t, _ in term)
    turned = _room('turned', (len(yaws), count, rows, cols))

    def work_turn(share: range) -> None:
        for k in share:
            turn(yaws[k], turned[k])

    if len(yaws) * rows * cols >= WORTH_A_THREAD:
        in_parallel(work_turn, shares(len(yaws)))
    else:
        work_turn(range(len(yaws)))
    out = np.empty((len(terms), len(yaws), n_x, n_y), np.float32)

    def work_term(term: int) -> None:
        out[term] = _row_products(turned, fields, terms[term])

    in_parallel(work_term, range(len(terms)))
    for k, yaw in enumerate(yaws):
        sink(yaw, out[:, k])


def _room(name: str, shape: tuple[int, ...]) -> Floats:
    """Return an array of this thread that holds anything; the one of the last frame if it fits."""
    rooms: dict[str, Floats] = _kept.__dict__.setdefault('rooms', {})
    room = rooms.get(name)
    if room is None or room.shape != shape:
        room = np.empty(shape, np.float32)
        rooms[name] = room
        if room.nbytes > KEPT_BYTES:
            del rooms[name]
    return room


def _row_products(turned: Floats, fields: Floats, term: Term) -> Floats:
    """One term (yaws, n_x, n_y); the pairs lie side by side in the rows of the matrices."""
    yaws, _, rows, cols = turned.shape
    high, wide = fields.shape[1], len(term) * cols
    n_x, n_y = 1 + high - rows, 1 + fields.shape[2] - cols
    pad = n_x - 1
    stacked = _room('stacked', (rows + 2 * pad, yaws, wide))
    stacked[:pad] = stacked[pad + rows :] = 0.0
    shifted = _room('shifted', (high, wide, n_y))
    for p, (template, field) in enumerate(term):
        part = slice(p * cols, (p + 1) * cols)
        stacked[pad : pad + rows, :, part] = turned[:, template].transpose(1, 0, 2)
        shifted[:, part] = sliding_window_view(fields[field], n_y, axis=1)
    step = stacked.strides
    meeting = as_strided(stacked, (high, n_x * yaws, wide), (step[0], step[1], step[2]))
    sums = np.matmul(meeting, shifted, out=_room('sums', (high, n_x * yaws, n_y))).sum(axis=0)
    # block row j holds template row k - (n_x - 1) + j, which is moved by n_x - 1 - j
    return np.asarray(sums.reshape(n_x, yaws, n_y)[::-1].transpose(1, 0, 2))
