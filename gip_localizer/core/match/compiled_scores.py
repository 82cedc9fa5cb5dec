# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A view against a window of the map, turned, over few translations, by the compiled loops."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.kernels.binding import PlaneArray
from gip_localizer.core.kernels.library import TurnedComparison
from gip_localizer.core.match.correlation import Term
from gip_localizer.core.match.template_rotation import is_little, Templates


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
        self._templates, self._terms, self._totals = templates, len(terms), totals
        pairs, pairs_of_term = _laid_out(tuple(terms))
        self._compare = TurnedComparison(
            templates.c_planes, PlaneArray(fields), pairs, pairs_of_term, totals
        )

    def sums_in(
        self, buffer: PlaneArray, affines: Sequence[Floats], size: tuple[int, int]
    ) -> tuple[Floats, Floats]:
        """
        Sum up the terms of yaws that are turned into one buffer after each other.

        Parameters
        ----------
        buffer : PlaneArray
            (templates, rows, cols) on the canvas.
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
        self, affines: Sequence[Floats], buffers: Sequence[PlaneArray], turned: Sequence[bool],
        totals: Floats, start: tuple[int, int], sums: Floats,
    ) -> None:
        """
        Sum up the terms of some yaws.

        Parameters
        ----------
        affines : sequence of (2, 3) float64
            `turn_affine` of every yaw.
        buffers : sequence of PlaneArray
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
        there = np.array(turned, np.uint8)
        for k, affine in enumerate(affines):
            if not turned[k] and not is_little(affine):
                totals[k] = self._templates.turned(buffers[k].array, affine, self._totals)
                there[k] = 1
        self._compare(np.array(affines), there, buffers, totals, start, sums)


@cache
def _laid_out(terms: tuple[Term, ...]) -> tuple[Grey, Grey]:
    """Pairs (n, 2) int32 of all terms, and their numbers (terms,) int32."""
    pairs = np.array([pair for term in terms for pair in term], np.int32)
    return pairs, np.array([len(term) for term in terms], np.int32)
