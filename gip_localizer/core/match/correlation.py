# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Sums of products of turned templates and map fields, over all translations.

A term is `S[d] = Σ_pairs Σ_i T_p[i] F_p[i + d]`. Few translations are done as one matrix product
per map row over all yaws (or by the compiled loops, `comparison`), many by transforms: the fields'
spectra serve all yaws, and the pairs of a term are added up as spectra, so that each term costs
one transform back for two yaws.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import math
import threading

import cv2
import numpy as np
from numpy.lib.stride_tricks import as_strided, sliding_window_view

from gip_localizer.core.arrays import Floats
from gip_localizer.core.match.fft import (
    add_products,
    channels,
    field_spectrum,
    make_transform,
    Plane,
    put_pair,
    Transform,
)
from gip_localizer.core.threads import in_parallel, shares

Term = tuple[tuple[int, int], ...]
"""Pairs of template and field (indices), whose correlations are added."""
Turn = Callable[[int, Floats], None]
"""Writes the templates (n, rows, cols) of a yaw: index of the yaw, where to."""
Sink = Callable[[range, Floats], None]
"""Takes yaws (indices) and their terms (n_terms, yaws, n_x, n_y), valid during the call only."""

PATCH_CELLS = 600_000  # of the window under all translations, up to which they are copied
PATCH_PIECE = 1024  # cells whose products BLAS sums at once: of more it makes copies of its own
PRODUCT_CANDIDATES = 200  # translations up to which matrix products beat transforms
PRODUCT_YAWS = 32  # at once, which bounds the memory
PRODUCT_PARTS = 2  # of the map rows, summed apart; fixed, so that bytes do not depend on cores
KEPT_BYTES = 1 << 23  # of an array, above which it is not kept between frames
WORTH_A_THREAD = 150_000  # cells of all yaws, below which threads wait more than they work


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
    few = n_x * n_y * math.prod(canvas) <= PATCH_CELLS
    if few or not takes_transforms(n_x, n_y):
        multiply = by_patches if few else by_products
        for start in range(0, yaws, PRODUCT_YAWS):
            batch = range(start, min(start + PRODUCT_YAWS, yaws))
            multiply(fields, terms, batch, canvas=canvas, turn=turn, sink=sink)
    else:
        by_transforms(fields, terms, yaws, canvas=canvas, turn=turn, sink=sink)


def takes_transforms(n_x: int, n_y: int) -> bool:
    """Whether so many translations are done by transforms."""
    return n_x * n_y > PRODUCT_CANDIDATES


def by_transforms(
    fields: Floats, terms: Sequence[Term], yaws: int, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """Correlate as `correlate` does, with transforms, two yaws at a time."""
    rows, cols = fields.shape[1:]
    transform = make_transform(rows, cols)
    spectra: list[Plane | None] = [None] * len(fields)

    def work_field(f: int) -> None:
        spectra[f] = field_spectrum(transform, fields[f])

    worth_it = yaws * rows * cols >= WORTH_A_THREAD
    in_parallel(work_field, range(len(fields)), worth_it=worth_it)
    known = [spectrum for spectrum in spectra if spectrum is not None]
    size = (1 + rows - canvas[0], 1 + cols - canvas[1])

    def work(pair: int) -> None:
        desk = _desk(transform, _templates(terms), len(terms), size, canvas)
        both = range(2 * pair, min(2 * pair + 2, yaws))
        sink(both, desk.terms(known, terms, both, turn))

    in_parallel(work, range(-(-yaws // 2)), worth_it=worth_it)


def _templates(terms: Sequence[Term]) -> int:
    return 1 + max(t for term in terms for t, _ in term)


class _Workspace:
    """The arrays that one thread works in."""

    def __init__(
        self, transform: Transform, templates: int, terms: int, size: tuple[int, int],
        canvas: tuple[int, int],
    ) -> None:
        self._transform = transform
        self._size = size
        self.plane: Plane = np.zeros(transform.shape, np.complex64)
        self._turned = np.zeros((2, templates, *canvas), np.float32)
        self._spectra = [np.empty_like(self.plane) for _ in range(templates)]
        self._sum, self._room = np.empty_like(self.plane), np.empty_like(self.plane)
        self._out = np.empty((terms, 2, *size), np.float32)

    def terms(
        self, fields: list[Plane], terms: Sequence[Term], yaws: range, turn: Turn
    ) -> Floats:
        """Return the terms (n_terms, yaws, n_x, n_y) of one yaw or two."""
        n_x, n_y = self._size
        for yaw, buffer in zip(yaws, self._turned, strict=False):
            turn(yaw, buffer)
        self._turned[len(yaws) :] = 0.0  # a yaw without a partner
        for template, spectrum in enumerate(self._spectra):
            self._transform_pair(self._turned[:, template], spectrum)
        for out, term in zip(self._out, terms, strict=True):
            product = self._product(fields, term, last=len(terms) == 1)
            found = self._transform.backward(product, n_x, self._room)[:n_x, :n_y]
            cv2.split(channels(found), list(out))
        return self._out[:, : len(yaws)]

    def _product(self, fields: list[Plane], term: Term, *, last: bool) -> Plane:
        """Add up a term's products; after the last a spectrum is spoilt, which costs least."""
        templates = [template for template, _ in term]
        spoilt = last and templates.count(templates[0]) == 1
        total = self._spectra[templates[0]] if spoilt else self._sum
        pairs = [(fields[field], self._spectra[template]) for template, field in term]
        add_products(pairs, total, self._room)
        return total

    def _transform_pair(self, pair: Floats, out: Plane) -> None:
        """Transform a template of two yaws, the second as the imaginary part."""
        put_pair(pair, self.plane)
        self._transform.forward(self.plane, pair.shape[1], out)


_kept = threading.local()


def _desk(transform: Transform, templates: int, terms: int, size: tuple[int, int],
          canvas: tuple[int, int]) -> _Workspace:
    """Return this thread's desk of the last frame if it fits, for no buffer is found faster."""
    key = (type(transform), transform.shape, templates, terms, size, canvas)
    if getattr(_kept, 'key', None) == key:
        desk: _Workspace = _kept.desk
        return desk
    _kept.key = _kept.desk = None
    desk = _Workspace(transform, templates, terms, size, canvas)
    if desk.plane.nbytes <= KEPT_BYTES:
        _kept.key, _kept.desk = key, desk
    return desk


def by_patches(
    fields: Floats, terms: Sequence[Term], yaws: range, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """Correlate as `correlate` does, with the part of the window under each translation copied."""
    n_x, n_y = 1 + fields.shape[1] - canvas[0], 1 + fields.shape[2] - canvas[1]
    cells = math.prod(canvas)
    patches = _room('patches', (len(fields), n_x, n_y, *canvas))
    patches[...] = sliding_window_view(fields, canvas, axis=(1, 2))
    flat = patches.reshape(len(fields), n_x * n_y, cells)
    turned = _room('turned', (_templates(terms), len(yaws), *canvas))
    for k, yaw in enumerate(yaws):
        turn(yaw, turned[:, k])
    rows = turned.reshape(len(turned), len(yaws), cells)
    sums = np.zeros((len(terms), len(yaws), n_x * n_y), np.float32)
    for out, term in zip(sums, terms, strict=True):
        for first in range(0, cells, PATCH_PIECE):
            piece = slice(first, first + PATCH_PIECE)
            for template, field in term:
                out += rows[template, :, piece] @ flat[field, :, piece].T
    sink(yaws, sums.reshape(len(terms), len(yaws), n_x, n_y))


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
    pad, count = n_x - 1, _templates(terms)
    # template rows, above and below them zeros; a row holds all yaws, a yaw all its templates
    stacked = _room('stacked', (rows + 2 * pad, len(yaws), count * cols))
    stacked[:pad] = stacked[pad + rows :] = 0.0

    def work_turn(share: range) -> None:
        for k in share:
            side_by_side = stacked[pad : pad + rows, k].reshape(rows, count, cols)
            turn(yaws[k], side_by_side.transpose(1, 0, 2))

    worth_it = len(yaws) * rows * cols >= WORTH_A_THREAD
    in_parallel(work_turn, shares(len(yaws)), worth_it=worth_it)
    parts = np.empty((PRODUCT_PARTS, len(terms), n_x, len(yaws), n_y), np.float32)
    cuts = np.linspace(0, fields.shape[1], PRODUCT_PARTS + 1).astype(int)

    def work_rows(part: int) -> None:
        chosen = slice(cuts[part], cuts[part + 1])
        for out, term in zip(parts[part], terms, strict=True):
            _row_products(stacked, fields[:, chosen], term, int(cuts[part]), cols, out)

    in_parallel(work_rows, range(PRODUCT_PARTS), worth_it=worth_it)
    # block row j holds template row k - (n_x - 1) + j, which is moved by n_x - 1 - j
    sink(yaws, parts.sum(axis=0)[:, ::-1].transpose(0, 2, 1, 3))


def _room(name: str, shape: tuple[int, ...]) -> Floats:
    """Return an array of this thread that holds anything; the one of the last frame if it fits."""
    buffers: dict[str, Floats] = _kept.__dict__.setdefault('buffers', {})
    buffer = buffers.get(name)
    if buffer is None or buffer.shape != shape:
        buffer = np.empty(shape, np.float32)
        buffers[name] = buffer
        if buffer.nbytes > KEPT_BYTES:
            del buffers[name]
    return buffer


def _row_products(
    stacked: Floats, fields: Floats, term: Term, top: int, cols: int, out: Floats
) -> None:
    """Write what some map rows, the first is `top`, add to a term: (n_x, yaws, n_y)."""
    n_x, yaws, n_y = out.shape
    high = fields.shape[1]
    step = stacked.strides
    out[...] = 0.0
    for run in _runs(term):
        first, wide = run[0][0], len(run) * cols
        shifted = _room('shifted', (high, wide, n_y))
        for p, (_, field) in enumerate(run):
            view = sliding_window_view(fields[field], n_y, axis=1)
            shifted[:, p * cols : (p + 1) * cols] = view
        meeting = as_strided(
            stacked[top:, :, first * cols :], (high, n_x * yaws, wide), (step[0], step[1], step[2])
        )
        sums = np.matmul(meeting, shifted, out=_room('sums', (high, n_x * yaws, n_y)))
        out += sums.sum(axis=0).reshape(out.shape)


def _runs(term: Term) -> Iterator[Term]:
    """Divide a term into runs of neighbouring templates, which lie side by side in a row."""
    pairs = sorted(term)
    start = 0
    for k in range(1, len(pairs) + 1):
        if k == len(pairs) or pairs[k][0] != pairs[k - 1][0] + 1:
            yield tuple(pairs[start:k])
            start = k
