# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The weighted norm as sums of products, and the sums as residuals.

`‖v - û‖²_G = Σ G v² - 2 Σ G v û + Σ G û²` (paper, OptimalClassifier). The normalized metrics
profile gain a and offset b out of `‖v - a û - b‖²_G` in closed form, with a ≥ 0. On a map that
is known everywhere Σ G v² is the same for all translations, and Σ G is.

"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.match.correlation import Term
from gip_localizer.core.match.template_rotation import Templates

# Indices (no unit) of the fields û, û² and 1 on known cells; templates 0, 1, 2 are G, G v and G
# v².
M, MM, KNOWN = 0, 1, 2
SUMS: dict[str, Term] = {
    'm': ((0, M),), 'mm': ((0, MM),), 'vm': ((1, M),),
    'w': ((0, KNOWN),), 'v': ((1, KNOWN),), 'vv': ((2, KNOWN),),
}
# Names of the sums that an entirely known window leaves to compute.
ON_KNOWN_MAP = ('m', 'mm', 'vm')


@dataclass(frozen=True, eq=False)
class Residuals:
    """
    Residuals of some candidates, with the other figures that their sums give.

    Attributes
    ----------
    residual : (...) float32
        Weighted mean square of v - û, gain and offset profiled out when normalized; inf where
        the overlap is too small.
    correlation : (...) float32 or None
        Weighted correlation coefficient; None where only the residual was requested.
    weights : float32
        Weight on known map cells; one number per yaw where the map is known.
    total : float
        The view's weight.

    """

    residual: Floats
    correlation: Floats | None
    weights: Floats
    total: float

    @property
    def overlap(self) -> Floats:
        """Share of the weight on known map cells, in the shape of `weights`."""
        return np.clip(self.weights / np.float32(max(self.total, 1e-20)), 0.0, 1.0)


class Scorer:
    """
    One view and one map window, as templates and fields whose correlations give the score.

    Parameters
    ----------
    values, weight : (rows, cols) float32
        The view and the Gramian's diagonal.
    window, known : (map rows, map cols) float32
        Map values, and 1 where they are known.
    normalized : bool
        True: gain and offset are profiled out.
    min_overlap : float
        Least share of the weight on known map cells.
    residual_only : bool
        True: no correlation coefficients; the plain norm then needs a single sum.
    everywhere : bool
        True: all cells of the window are known, and are not checked.

    """

    def __init__(
        self, values: Floats, weight: Floats, window: Floats, known: Floats, *,
        normalized: bool, min_overlap: float, residual_only: bool = False,
        everywhere: bool = False,
    ) -> None:
        self.everywhere = everywhere or bool(known.all())
        self._normalized, self._min_overlap = normalized, min_overlap
        self._joint = residual_only and not normalized
        self._total = float(cv2.sumElems(weight)[0])
        level = self._level(values, weight)
        self.templates = self._make_templates(values, weight, level)
        self.fields = np.empty((2 if self.everywhere else 3, *window.shape), np.float32)
        if normalized:  # which any offset suits, so that sums of squares are of small numbers
            level = _mean(window, known)
        np.subtract(window, level if self.everywhere else level * known, out=self.fields[M])
        np.multiply(self.fields[M], self.fields[M], out=self.fields[MM])
        if not self.everywhere:
            self.fields[KNOWN] = known
        self.terms = self._terms()

    def _level(self, values: Floats, weight: Floats) -> np.float32:
        """Return the weighted mean of the view, about which the sums are taken."""
        if self._total <= 0.0:
            return np.float32(0.0)
        return np.float32(np.dot(weight.ravel(), values.ravel()) / self._total)

    def _make_templates(self, values: Floats, weight: Floats, level: np.float32) -> Templates:
        """Return G, G v and, where the map has gaps, G v²; for the joint term -2 G v."""
        templates = Templates(2 if self.everywhere else 3, weight.shape)
        v = values - level
        weighted = weight * v
        self._total_vv = np.float32(np.dot(weighted.ravel(), v.ravel()))
        planes = templates.planes
        planes[0] = weight
        np.multiply(weighted, np.float32(-2.0 if self._joint else 1.0), out=planes[1])
        if not self.everywhere:
            np.multiply(weighted, v, out=planes[2])
        return templates

    def _terms(self) -> list[Term]:
        if not self._joint:
            return [SUMS[name] for name in (ON_KNOWN_MAP if self.everywhere else SUMS)]
        squares = ((0, MM), (1, M))
        return [squares] if self.everywhere else [(*squares, (2, KNOWN)), SUMS['w']]

    @property
    def sums_needed(self) -> int:
        """Number of turned templates, the first ones, of which `score` needs the sums."""
        if not self.everywhere:
            return 0
        return 1 if self._joint else 2

    def score(self, sums: Floats, turned: Floats) -> Residuals:
        """
        Turn sums into residuals.

        Parameters
        ----------
        sums : (n_terms, yaws, ...) float32
            In the order of `terms`; overwritten.
        turned : (yaws, 2, ...) float32
            Σ G and Σ G v of the turned templates, as far as `sums_needed`.

        """
        tiny = np.float32(1e-12 * max(self._total, 1e-20))
        if self._joint:
            return self._joint_score(sums, turned, tiny)
        if self.everywhere:
            m, mm, vm = sums
            weights, v, vv = turned[:, 0], turned[:, 1], self._total_vv
        else:
            m, mm, vm, weights, v, vv = sums
        w = np.maximum(weights, tiny)
        mean_v, mean_m = v / w, m / w
        var_v = np.maximum(vv / w - mean_v**2, 0.0)
        var_m = np.maximum(mm / w - mean_m**2, 0.0)
        cov = vm / w - mean_v * mean_m
        spread = np.sqrt(var_v * var_m)
        correlation = np.divide(cov, spread, out=np.zeros_like(cov), where=spread > 1e-9)
        correlation = np.clip(correlation, -1.0, 1.0)
        if self._normalized:
            residual = var_v * (1.0 - np.maximum(correlation, 0.0) ** 2)
        else:
            residual = np.maximum((vv - 2.0 * vm + mm) / w, 0.0)
        return self._judged(residual, correlation, weights)

    def _joint_score(self, sums: Floats, turned: Floats, tiny: np.float32) -> Residuals:
        weights = turned[:, 0] if self.everywhere else sums[1]
        if self.everywhere:
            sums[0] += self._total_vv
            sums[0] *= np.float32(1.0) / np.maximum(weights, tiny)
        else:
            sums[0] /= np.maximum(weights, tiny)
        return self._judged(np.maximum(sums[0], 0.0, out=sums[0]), None, weights)

    def _judged(
        self, residual: Floats, correlation: Floats | None, weights: Floats
    ) -> Residuals:
        low = weights < np.float32(self._min_overlap * max(self._total, 1e-20))
        if low.any():
            residual[np.broadcast_to(low, residual.shape)] = np.inf
        return Residuals(residual, correlation, weights, self._total)


def _mean(window: Floats, known: Floats) -> np.float32:
    """Mean of the known cells; the others hold 0."""
    return np.float32(cv2.sumElems(window)[0] / max(cv2.sumElems(known)[0], 1.0))
