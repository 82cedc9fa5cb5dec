# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Estimate the vignetting of a lens from road that is seen at two positions in the image.

The grey in a map must not depend on the position in the image. With a dark lower edge, each frame
would be darker than the far part of the frame before, and the brightness would drift along the
drive.

"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, upper_median

PASSES = 4
"""Number of iterations of the robust fit; chosen."""
OUTLIER = 3.0
"""Residual, in robust standard deviations, from which a cell is an outlier; chosen."""
LIFT = (0.7, 6.0)
"""Accepted brightness factors of the corners; outside this range the fit is rejected; chosen."""
LEAST_CELLS = 200
"""Least number of common cells of a pair of frames; chosen."""


class Vignetting(NamedTuple):
    """
    Correction factor of brightness: `1 + squared ρ² + fourth ρ⁴`, ρ = 1 in the image corners.

    Attributes
    ----------
    squared, fourth : float
        Coefficients; both are 0 for a lens without vignetting.

    """

    squared: float = 0.0
    fourth: float = 0.0

    def lift(self, radius_sq: Floats) -> Floats:
        """Return the correction factor (...) at squared radii (...)."""
        return np.asarray(1.0 + (self.squared + self.fourth * radius_sq) * radius_sq)


class CommonCells(NamedTuple):
    """Cells that two frames see: grey and squared radius of each, common weight; all (n,)."""

    value: tuple[Floats, Floats]
    radius_sq: tuple[Floats, Floats]
    weight: Floats


def fit_vignetting(pairs: Sequence[CommonCells]) -> Vignetting:
    """
    Return the vignetting for which pairs of frames agree, up to a gain and an offset per pair.

    Without pairs, or if the fit is not plausible for a lens, the result is no correction.

    """
    pairs = [pair for pair in pairs if len(pair.weight) >= LEAST_CELLS]
    if not pairs:
        return Vignetting()
    found = _solved(pairs, 2)
    if found.min() < 0.0:  # no lens does that: the data determine only one coefficient
        found = _solved(pairs, 1)
    vignetting = Vignetting(float(found[0]), float(found[1]))
    return vignetting if LIFT[0] <= vignetting.lift(np.array(1.0)) <= LIFT[1] else Vignetting()


def _solved(pairs: Sequence[CommonCells], count: int) -> Floats:
    """Return both coefficients (2,): the first `count` are fitted, the others are 0."""
    found: Floats = np.zeros(2)
    kept: list[Bools] = [np.ones(len(pair.weight), bool) for pair in pairs]
    gains = [1.0] * len(pairs)
    for _ in range(PASSES):
        normal, right = 1e-9 * np.eye(2), np.zeros(2)
        for pair, keep, gain in zip(pairs, kept, gains, strict=True):
            terms, target = _free_of_exposure(pair, keep, gain)
            normal += terms.T @ terms
            right += terms.T @ target
        found[:count] = np.linalg.solve(normal[:count, :count], right[:count])
        for k, pair in enumerate(pairs):
            gains[k], kept[k] = _reweighted(pair, kept[k], gains[k], found)
    return found


def _terms(pair: CommonCells, gain: float) -> tuple[Floats, Floats]:
    """Return the columns (n, 2) of the two coefficients and those (n, 2) of the exposure."""
    (a, b), (near, far) = pair.value, pair.radius_sq
    terms = np.column_stack([gain * a * near - b * far, gain * a * near**2 - b * far**2])
    return terms, np.column_stack([a, np.ones(len(a))])


def _free_of_exposure(
    pair: CommonCells, keep: Bools, gain: float
) -> tuple[Floats, Floats]:
    """Return weighted terms and target, orthogonal to the columns of gain and offset."""
    root = np.sqrt(pair.weight[keep] / pair.weight[keep].sum())[:, None]
    terms, exposure = _terms(pair, gain)
    basis, _ = np.linalg.qr(exposure[keep] * root)
    columns = np.column_stack([terms[keep], pair.value[1][keep]]) * root
    free = columns - basis @ (basis.T @ columns)
    return free[:, :2], free[:, 2]


def _reweighted(pair: CommonCells, keep: Bools, gain: float, found: Floats) -> tuple[float, Bools]:
    """Return the gain of a pair and the cells that agree, given the coefficients."""
    terms, exposure = _terms(pair, gain)
    target = pair.value[1] - terms @ found
    root = np.sqrt(pair.weight[keep])
    line = np.linalg.lstsq(exposure[keep] * root[:, None], target[keep] * root, rcond=None)[0]
    residual = np.abs(target - exposure @ line)
    agree = residual <= OUTLIER * max(1.4826 * upper_median(residual), 1e-6)
    return float(np.clip(line[0], 0.2, 5.0)), agree
