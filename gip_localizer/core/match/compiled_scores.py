# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A view against a window of the map, turned, over few translations, by the compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.kernels.library import address, c_planes, Compared, kernels, Planes
from gip_localizer.core.match.correlation import Term
from gip_localizer.core.match.template_rotation import is_little, Templates


class Buffer:
    """
    Buffer for the templates of one yaw, turned.

    Attributes
    ----------
    planes : (templates, rows, cols) float32
        Rows may be apart, their elements not.

    """

    def __init__(self, planes: Floats) -> None:
        self.planes = planes
        self.c_planes = c_planes(planes)


class Comparison:
    """
    Templates of a view and fields of a window.

    Parameters
    ----------
    templates : Templates
        Of the view.
    fields : (n_fields, rows, cols) float32
        Of the window.
    terms : sequence of Term
        What is summed, as `correlate` does.
    totals : int
        Of how many templates, the first ones, the sums are wanted.

    """

    def __init__(
        self, templates: Templates, fields: Floats, terms: Sequence[Term], totals: int
    ) -> None:
        self._templates, self._fields, self._totals = templates, fields, totals
        self._pairs, self._pairs_of_term = _laid_out(tuple(terms))
        self._terms = len(terms)
        self._c = Compared(
            c_planes(templates.planes), *templates.planes.shape, c_planes(fields),
            address(self._pairs, np.int32), address(self._pairs_of_term, np.int32),
            len(terms), totals,
        )

    def sums_in(
        self, buffer: Buffer, affines: Sequence[Floats], size: tuple[int, int]
    ) -> tuple[Floats, Floats]:
        """
        Sum up the terms of yaws that are turned into one buffer after each other.

        Parameters
        ----------
        buffer : Buffer
            On the canvas.
        affines : sequence of (2, 3) float64
            `turn_affine` of every yaw.
        size : (int, int)
            Translations in x and in y.

        Returns
        -------
        sums : (terms, yaws, n_x, n_y) float32
            New arrays, as `totals`.
        totals : (yaws, totals) float32
            Sums of the turned templates.

        """
        sums = np.empty((len(affines), self._terms, *size), np.float32)
        totals = np.empty((len(affines), self._totals), np.float32)
        whole = slice(0, len(affines))
        alone = [slice(k, k + 1) for k in range(len(affines))]
        for yaws in [whole] if all(map(is_little, affines)) else alone:
            buffers, chosen = [buffer] * (yaws.stop - yaws.start), affines[yaws]
            self.compare(chosen, buffers, [False] * len(buffers), totals[yaws], (0, 0), sums[yaws])
        return sums.transpose(1, 0, 2, 3), totals

    def compare(
        self, affines: Sequence[Floats], buffers: Sequence[Buffer], turned: Sequence[bool],
        totals: Floats, start: tuple[int, int], sums: Floats,
    ) -> None:
        """
        Sum up the terms of some yaws.

        Parameters
        ----------
        affines : sequence of (2, 3) float64
            `turn_affine` of every yaw.
        buffers : sequence of Buffer
            Where the turned templates go, all of one shape.
        turned : sequence of bool
            Which buffers hold the turned templates already.
        totals : (yaws, totals) float32
            Sums of the templates; those of yaws that are turned here are written.
        start : (int, int)
            The first translation in x and in y.
        sums : (yaws, terms, n_x, n_y) float32
            To be written; contiguous.

        """
        _, rows, cols = buffers[0].planes.shape
        (x, y), (n_x, n_y) = start, sums.shape[2:]
        assert 0 <= x <= self._fields.shape[1] - rows - n_x + 1
        assert 0 <= y <= self._fields.shape[2] - cols - n_y + 1
        there = np.array(turned, np.uint8)
        for k, affine in enumerate(affines):
            if not turned[k] and not is_little(affine):
                totals[k] = self._templates.turned(buffers[k].planes, affine, self._totals)
                there[k] = 1
        kernels().compare_turned(
            self._c, len(buffers), address(np.array(affines), np.float64),
            address(there, np.uint8),
            (Planes * len(buffers))(*(buffer.c_planes for buffer in buffers)), rows, cols,
            address(totals, np.float32), x, y, n_x, n_y, address(sums, np.float32),
        )


@cache
def _laid_out(terms: tuple[Term, ...]) -> tuple[Grey, Grey]:
    """Pairs (n, 2) int32 of all terms, and their numbers (terms,) int32."""
    pairs = np.array([pair for term in terms for pair in term], np.int32)
    return pairs, np.array([len(term) for term in terms], np.int32)
