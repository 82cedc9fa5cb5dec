# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Sums of products of turned templates and map fields, over all translations.

A term is `S[d] = Σ_pairs Σ_i T_p[i] F_p[i + d]`, computed by transforms: the fields' spectra serve
all yaws, and the pairs of a term are added up as spectra, so that each term costs one transform
back for two yaws. Few translations are summed directly where there are compiled loops
(`compiled_scores`); without them transforms do these too.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import threading

import cv2
import numpy as np

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
from gip_localizer.core.threads import in_parallel

Term = tuple[tuple[int, int], ...]
"""Pairs of template and field (indices), whose correlations are added."""
Turn = Callable[[int, Floats], None]
"""Writes the templates (n, rows, cols) of a yaw: index of the yaw, where to."""
Sink = Callable[[range, Floats], None]
"""Takes yaws (indices) and their terms (n_terms, yaws, n_x, n_y), valid during the call only."""

# Largest size (bytes) of an array that is kept between frames (design choice: 8 MiB, because
# larger ones belong to searches of the whole map, which are rare).
KEPT_BYTES = 1 << 23
# Least number of cells of all yaws for which threads are used (design choice: 150,000, because
# with fewer the threads wait longer than they work).
MIN_FOR_THREADS = 150_000


def correlate(
    fields: Floats, terms: Sequence[Term], yaws: int, *, canvas: tuple[int, int],
    turn: Turn, sink: Sink,
) -> None:
    """
    Give the terms of every yaw to the sink, from several threads, in any order.

    Two yaws at a time, as the real and the imaginary part of one plane.

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
    rows, cols = fields.shape[1:]
    transform = make_transform(rows, cols)
    spectra: list[Plane | None] = [None] * len(fields)

    def work_field(f: int) -> None:
        spectra[f] = field_spectrum(transform, fields[f])

    worth_it = yaws * rows * cols >= MIN_FOR_THREADS
    in_parallel(work_field, range(len(fields)), worth_it=worth_it)
    known = [spectrum for spectrum in spectra if spectrum is not None]
    size = (1 + rows - canvas[0], 1 + cols - canvas[1])

    def work(pair: int) -> None:
        workspace = _workspace(transform, _templates(terms), len(terms), size, canvas)
        both = range(2 * pair, min(2 * pair + 2, yaws))
        sink(both, workspace.terms(known, terms, both, turn))

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
        self._sum, self._buffer = np.empty_like(self.plane), np.empty_like(self.plane)
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
            found = self._transform.backward(product, n_x, self._buffer)[:n_x, :n_y]
            cv2.split(channels(found), list(out))
        return self._out[:, : len(yaws)]

    def _product(self, fields: list[Plane], term: Term, *, last: bool) -> Plane:
        """Add up a term's products; after the last a spectrum is spoilt, which costs least."""
        templates = [template for template, _ in term]
        spoilt = last and templates.count(templates[0]) == 1
        total = self._spectra[templates[0]] if spoilt else self._sum
        pairs = [(fields[field], self._spectra[template]) for template, field in term]
        add_products(pairs, total, self._buffer)
        return total

    def _transform_pair(self, pair: Floats, out: Plane) -> None:
        """Transform a template of two yaws, the second as the imaginary part."""
        put_pair(pair, self.plane)
        self._transform.forward(self.plane, pair.shape[1], out)


_kept = threading.local()


def _workspace(transform: Transform, templates: int, terms: int, size: tuple[int, int],
               canvas: tuple[int, int]) -> _Workspace:
    """Return the workspace of this thread's last frame if it fits: new memory takes longer."""
    key = (type(transform), transform.shape, templates, terms, size, canvas)
    if getattr(_kept, 'key', None) == key:
        workspace: _Workspace = _kept.workspace
        return workspace
    _kept.key = _kept.workspace = None
    workspace = _Workspace(transform, templates, terms, size, canvas)
    if workspace.plane.nbytes <= KEPT_BYTES:
        _kept.key, _kept.workspace = key, workspace
    return workspace
