# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Light that the lens loses towards the corners, told by road that is seen at several places.

What a map is built of must not depend on where in the image it was seen: a dark lower edge would
make each frame darker than the last one's far part, and the brightness drift along the drive.

"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, median

PASSES = 4
OUTLIER = 3.0  # robust standard deviations
LIFT = (0.7, 6.0)  # least and most that a corner is lifted; beyond, the fit is not believed
LEAST_CELLS = 200  # of a pair of frames


class Shading(NamedTuple):
    """
    Brightness is lifted by `1 + squared ρ² + fourth ρ⁴`, ρ = 1 in the corners of the image.

    Attributes
    ----------
    squared, fourth : float
        0: the lens loses nothing.

    """

    squared: float = 0.0
    fourth: float = 0.0

    def lift(self, radius_sq: Floats) -> Floats:
        """Factor (...) at squared radii (...)."""
        return np.asarray(1.0 + (self.squared + self.fourth * radius_sq) * radius_sq)


class SeenTwice(NamedTuple):
    """Road in two frames: grey and squared radius of each, and what both weigh; all (n,)."""

    value: tuple[Floats, Floats]
    radius_sq: tuple[Floats, Floats]
    weight: Floats


def fit_shading(pairs: Sequence[SeenTwice]) -> Shading:
    """
    Return the shading that makes pairs of frames agree up to a gain and an offset of each pair.

    Without pairs, or where the result is none that a lens has, nothing is lifted.

    """
    pairs = [pair for pair in pairs if len(pair.weight) >= LEAST_CELLS]
    if not pairs:
        return Shading()
    found = _solved(pairs, 2)
    if found.min() < 0.0:  # no lens does that: too little is told for two coefficients
        found = _solved(pairs, 1)
    shading = Shading(float(found[0]), float(found[1]))
    return shading if LIFT[0] <= shading.lift(np.array(1.0)) <= LIFT[1] else Shading()


def _solved(pairs: Sequence[SeenTwice], count: int) -> Floats:
    """Return both coefficients (2,), the first `count` of them fitted and others 0."""
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
            gains[k], kept[k] = _judged(pair, kept[k], gains[k], found)
    return found


def _terms(pair: SeenTwice, gain: float) -> tuple[Floats, Floats]:
    """Return what the coefficients multiply, (n, 2), and the exposure's columns (n, 2)."""
    (a, b), (near, far) = pair.value, pair.radius_sq
    shades = np.column_stack([gain * a * near - b * far, gain * a * near**2 - b * far**2])
    return shades, np.column_stack([a, np.ones(len(a))])


def _free_of_exposure(
    pair: SeenTwice, keep: Bools, gain: float
) -> tuple[Floats, Floats]:
    """Return terms and target, weighted, without what gain and offset can explain."""
    root = np.sqrt(pair.weight[keep] / pair.weight[keep].sum())[:, None]
    shades, exposure = _terms(pair, gain)
    basis, _ = np.linalg.qr(exposure[keep] * root)
    columns = np.column_stack([shades[keep], pair.value[1][keep]]) * root
    free = columns - basis @ (basis.T @ columns)
    return free[:, :2], free[:, 2]


def _judged(pair: SeenTwice, keep: Bools, gain: float, found: Floats) -> tuple[float, Bools]:
    """Return the gain of a pair and the cells that agree, given the shading."""
    shades, exposure = _terms(pair, gain)
    target = pair.value[1] - shades @ found
    root = np.sqrt(pair.weight[keep])
    line = np.linalg.lstsq(exposure[keep] * root[:, None], target[keep] * root, rcond=None)[0]
    residual = np.abs(target - exposure @ line)
    agree = residual <= OUTLIER * max(1.4826 * median(residual), 1e-6)
    return float(np.clip(line[0], 0.2, 5.0)), agree
