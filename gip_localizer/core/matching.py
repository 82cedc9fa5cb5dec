# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Step 3: map window and bird's-eye view → score of every candidate (x, y, yaw).

The weighted norm `‖v - û‖²_G = Σ G v² - 2 Σ G v û + Σ G û²` (paper, OptimalClassifier) is three
correlations over translations, done by FFT; the map's transforms serve all yaws, for which the
view's sums G and G v are rotated. The normalized metrics profile gain a and offset b out of
`‖v - a û - b‖²_G` in closed form, with a ≥ 0.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye import View
from gip_localizer.core.footprints import Grid
from gip_localizer.core.levels import locally_centred
from gip_localizer.core.pose import Pose2
from gip_localizer.core.raster_map import RasterMap

FFT_WORKERS = 2
YAW_BATCH = 16


@dataclass(frozen=True)
class Lattice:
    """
    The candidates: offsets from an anchor pose, in the anchor's own axes.

    Attributes
    ----------
    anchor : Pose2
        Prior pose of base in map.
    step : float
        Step in x and y, metres.
    half : (int, int)
        Steps ahead (= behind) and left (= right).
    yaws : (n,) float64
        Offsets in heading, radians.

    """

    anchor: Pose2
    step: float
    half: tuple[int, int]
    yaws: Floats

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of yaws, of x offsets (first is farthest ahead), of y offsets (left first)."""
        return len(self.yaws), 2 * self.half[0] + 1, 2 * self.half[1] + 1

    def offset(self, index: Floats) -> Pose2:
        """Pose of a (fractional) index (yaw, x, y) relative to the anchor."""
        yaw = float(np.interp(index[0], np.arange(len(self.yaws)), self.yaws))
        return Pose2(
            (self.half[0] - float(index[1])) * self.step,
            (self.half[1] - float(index[2])) * self.step,
            yaw,
        )

    def pose(self, index: Floats) -> Pose2:
        """Pose of base in map of a (fractional) index (yaw, x, y)."""
        return self.anchor @ self.offset(index)


def make_lattice(
    anchor: Pose2, *, x: float, y: float, yaw: float, yaw_step: float, step: float
) -> Lattice:
    """Return the lattice that covers ±x, ±y (m) and ±yaw (rad) about the anchor."""
    count = math.ceil(yaw / yaw_step - 1e-9)
    half = (math.ceil(x / step - 1e-9), math.ceil(y / step - 1e-9))
    return Lattice(anchor, step, half, np.arange(-count, count + 1) * yaw_step)


@dataclass(frozen=True, eq=False)
class Scores:
    """
    The score surface.

    Attributes
    ----------
    lattice : Lattice
        The candidates.
    residual : (yaws, x, y) float32
        Weighted mean square of v - û (gain and offset profiled out when normalized), in grey
        levels squared; inf where the overlap is too small. The least is the best.
    correlation : (yaws, x, y) float32
        Weighted correlation coefficient of view and map, 0 where undefined.
    overlap : (yaws, x, y) float32
        Share of the view's weight that lies on known map cells.

    """

    lattice: Lattice
    residual: Floats
    correlation: Floats
    overlap: Floats

    def best(self) -> tuple[int, int, int]:
        """Index of the best candidate."""
        index = np.unravel_index(int(np.argmin(self.residual)), self.residual.shape)
        return int(index[0]), int(index[1]), int(index[2])


def match(
    view: View, weight: Floats, raster_map: RasterMap, lattice: Lattice, *,
    normalized: bool, min_overlap: float, centred: bool = False,
) -> Scores:
    """
    Score every candidate of the lattice.

    Parameters
    ----------
    view : View
        Bird's-eye view; its grid's resolution is the lattice's step.
    weight : (rows, cols) float32
        The Gramian's diagonal; 0 for cells without weight.
    raster_map : RasterMap
        The map, or a crop of it that covers the window.
    lattice : Lattice
        The candidates.
    normalized : bool
        True: gain and offset are profiled out.
    min_overlap : float
        Least share of the weight on known map cells, 0..1.
    centred : bool
        True: local means are taken out of view and map, and outliers clipped, first.

    Returns
    -------
    Scores
        Residual, correlation and overlap of every candidate.

    """
    canvas = _canvas(view.grid, lattice)
    window, known = _window(raster_map, canvas, lattice)
    values = view.patch
    if centred:
        values = locally_centred(values, weight, view.grid.resolution)
        window = locally_centred(window, known, view.grid.resolution)
    level = np.float32(np.average(values, weights=weight)) if weight.any() else np.float32(0)
    sums = _correlate(_templates(values, weight, level), window - level * known, known,
                      view.grid, canvas, lattice)
    return _score(sums, lattice, normalized=normalized, min_overlap=min_overlap)


@dataclass
class _Sums:
    """Weighted sums per candidate: of 1, v, v², û, û² and v û over known map cells."""

    total: float
    w: Floats
    v: Floats
    vv: Floats
    m: Floats
    mm: Floats
    vm: Floats


def _canvas(grid: Grid, lattice: Lattice) -> Grid:
    """Return the cells, in the anchor's axes, that the view covers at any of the yaws."""
    corners = np.array([[x, y] for x in (grid.far, grid.far - grid.rows * grid.resolution)
                        for y in (grid.left, grid.left - grid.cols * grid.resolution)])
    turned = np.concatenate([
        corners @ Pose2(0.0, 0.0, float(yaw)).rotation().T
        for yaw in _extreme_yaws(lattice.yaws)
    ])
    steps = grid.resolution
    far = grid.far + math.ceil((turned[:, 0].max() - grid.far) / steps - 1e-6) * steps
    left = grid.left + math.ceil((turned[:, 1].max() - grid.left) / steps - 1e-6) * steps
    rows = math.ceil((far - turned[:, 0].min()) / steps - 1e-6)
    cols = math.ceil((left - turned[:, 1].min()) / steps - 1e-6)
    return Grid(far, left, rows, cols, steps)


def _extreme_yaws(yaws: Floats) -> Floats:
    """Yaws whose union of views holds every view in between (quarter turns included)."""
    if len(yaws) == 1:
        return yaws
    return np.linspace(yaws[0], yaws[-1], 2 + int((yaws[-1] - yaws[0]) / 0.02))


def _window(
    raster_map: RasterMap, canvas: Grid, lattice: Lattice
) -> tuple[Floats, Floats]:
    """Map values and known (0 or 1) on the canvas widened by the translations."""
    widened = Grid(
        canvas.far + lattice.half[0] * canvas.resolution,
        canvas.left + lattice.half[1] * canvas.resolution,
        canvas.rows + 2 * lattice.half[0],
        canvas.cols + 2 * lattice.half[1],
        canvas.resolution,
    )
    values, valid = raster_map.sample(lattice.anchor.transform(widened.points()))
    return values.reshape(widened.shape), valid.reshape(widened.shape).astype(np.float32)


def _templates(values: Floats, weight: Floats, level: np.float32) -> Floats:
    """G, G v and G v² as (rows, cols, 3), v relative to the level."""
    v = np.where(weight > 0.0, values - level, np.float32(0.0))
    return np.dstack([weight, weight * v, weight * v * v]).astype(np.float32)


def rotated(templates: Floats, grid: Grid, canvas: Grid, yaw: float) -> Floats:
    """Templates (rows, cols, n) of a view turned by a yaw, on the canvas (bilinear)."""
    c, s, step = math.cos(yaw), math.sin(yaw), grid.resolution
    # canvas cell → anchor metres → base metres → view cell, all affine
    x0, y0 = canvas.far - 0.5 * step, canvas.left - 0.5 * step
    row0 = (grid.far - (c * x0 + s * y0)) / step - 0.5
    col0 = (grid.left - (-s * x0 + c * y0)) / step - 0.5
    affine = np.array([[c, -s, col0], [s, c, row0]])
    return np.asarray(cv2.warpAffine(
        templates, affine, (canvas.cols, canvas.rows),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_CONSTANT,
    ), np.float32)


def _correlate(
    templates: Floats, window: Floats, known: Floats, grid: Grid, canvas: Grid,
    lattice: Lattice,
) -> _Sums:
    """All weighted sums over all candidates; six correlations, or three on a full map."""
    everywhere = bool(known.all())
    size = [fft.next_fast_len(n, real=True) for n in window.shape]

    def spectrum(values: Floats) -> NDArray[np.complex64]:
        return np.asarray(fft.rfft2(values, size, workers=FFT_WORKERS))

    f_m, f_mm = spectrum(window), spectrum(window * window)
    f_known = None if everywhere else spectrum(known)
    n_yaw, n_x, n_y = lattice.shape
    planes = {name: np.empty(lattice.shape, np.float32) for name in
              ('w', 'v', 'vv', 'm', 'mm', 'vm')}
    for start in range(0, n_yaw, YAW_BATCH):
        batch = slice(start, min(start + YAW_BATCH, n_yaw))
        turned = np.stack([
            rotated(templates, grid, canvas, float(yaw)) for yaw in lattice.yaws[batch]
        ])
        count = 2 if everywhere else 3
        spectra = np.conj(fft.rfft2(np.moveaxis(turned[..., :count], 3, 0), size,
                                    workers=FFT_WORKERS))

        def placed(product: NDArray[np.complex64]) -> Floats:
            full = fft.irfft2(product, size, workers=FFT_WORKERS)
            return np.asarray(full[:, :n_x, :n_y], np.float32)

        planes['m'][batch] = placed(spectra[0] * f_m)
        planes['mm'][batch] = placed(spectra[0] * f_mm)
        planes['vm'][batch] = placed(spectra[1] * f_m)
        if f_known is None:
            sums = turned.sum(axis=(1, 2), dtype=np.float64).astype(np.float32)
            planes['w'][batch] = sums[:, 0, None, None]
            planes['v'][batch] = sums[:, 1, None, None]
            planes['vv'][batch] = templates[..., 2].sum(dtype=np.float64)
        else:
            for plane, index in (('w', 0), ('v', 1), ('vv', 2)):
                planes[plane][batch] = placed(spectra[index] * f_known)
    return _Sums(float(templates[..., 0].sum(dtype=np.float64)), **planes)


def _score(sums: _Sums, lattice: Lattice, *, normalized: bool, min_overlap: float) -> Scores:
    tiny = np.float32(1e-12 * max(sums.total, 1e-20))
    w = np.maximum(sums.w, tiny)
    mean_v, mean_m = sums.v / w, sums.m / w
    var_v = np.maximum(sums.vv / w - mean_v**2, 0.0)
    var_m = np.maximum(sums.mm / w - mean_m**2, 0.0)
    cov = sums.vm / w - mean_v * mean_m
    spread = np.sqrt(var_v * var_m)
    correlation = np.divide(cov, spread, out=np.zeros_like(cov), where=spread > 1e-9)
    correlation = np.clip(correlation, -1.0, 1.0)
    if normalized:
        residual = var_v * (1.0 - np.maximum(correlation, 0.0) ** 2)
    else:
        residual = np.maximum((sums.vv - 2.0 * sums.vm + sums.mm) / w, 0.0)
    overlap = np.clip(sums.w / max(sums.total, 1e-20), 0.0, 1.0)
    residual = np.where(overlap >= min_overlap, residual, np.float32(np.inf))
    return Scores(
        lattice, residual.astype(np.float32), correlation.astype(np.float32),
        overlap.astype(np.float32),
    )
