# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The map of the report: the road, true and estimated path, 95 % ellipses."""

from __future__ import annotations

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.evaluation.error_table import ELLIPSE_95, ErrorTable
from gip_localizer.evaluation.run import Run
from gip_localizer.visualization.match_images import NO_DATA
from gip_localizer.visualization.style import ESTIMATE, TRUTH, WRONG

Floats = NDArray[np.float64]
ELLIPSE = '#e07a00'
NO_MAP = '#' + bytes(reversed(NO_DATA)).hex()
"""Colour where there is no map."""
PIXELS = 700
"""Pixels along the larger side of the background; chosen."""
MAX_SMOOTHED_CELLS = 2e7
"""Largest number of map cells that are smoothed for the background; chosen."""
ELLIPSES = 16
"""Largest number of drawn ellipses; chosen."""


def map_figure(run: Run, table: ErrorTable) -> Figure:
    """Draw the paths over the map, with ellipses enlarged by the factor in the title."""
    box = _box(run, table)
    height = 4.6 * (box[3] - box[1]) / max(box[2] - box[0], 1e-9)
    figure = Figure(figsize=(4.8, min(max(height, 1.4), 5.6) + 1.0))
    axes = figure.subplots()
    axes.grid(False)
    if run.raster_map is not None:
        _draw_background(axes, run.raster_map, box)
    if run.truth is not None:
        axes.plot(*run.truth.poses[:, :2].T, color=TRUTH, lw=2.5, alpha=0.8, label='truth')
    axes.plot(*table.poses[:, :2].T, color=ESTIMATE, lw=1.0, marker='.', ms=3, label='estimate')
    wrong = table.wrong
    if wrong.any():
        axes.plot(*table.poses[wrong, :2].T, 'x', color=WRONG, ms=6, label='wrong pose')
    factor = _draw_ellipses(axes, run, table, box)
    label = '' if factor is None else f'95 % ellipses, {factor} times enlarged'
    axes.set(xlim=box[::2], ylim=box[1::2], aspect='equal', xlabel='x [m]', ylabel='y [m]')
    axes.set_title(label if factor != 1 else '95 % ellipses at true size', loc='right', fontsize=9,
                   pad=22.0)
    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9)
    return figure


def _box(run: Run, table: ErrorTable) -> tuple[float, float, float, float]:
    """Return least x, least y, largest x and largest y to show, metres."""
    points = table.poses[np.isfinite(table.poses[:, 0]), :2]
    if run.truth is not None:
        points = np.vstack([points, run.truth.poses[:, :2]])
    if len(points) == 0:
        if run.raster_map is None:
            return (-1.0, -1.0, 1.0, 1.0)
        return run.raster_map.bounds
    low, high = points.min(axis=0), points.max(axis=0)
    size = max(*(high - low), 8.0)
    pad = np.maximum(0.06 * size, (0.35 * size - (high - low)) / 2.0)
    low, high = low - pad, high + pad
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def _draw_background(axes: Axes, raster_map: RasterMap,
                     box: tuple[float, float, float, float]) -> None:
    left, bottom, right, top = box
    pixel = max(right - left, top - bottom) / PIXELS
    x = np.arange(left + pixel / 2, right, pixel)
    y = np.arange(top - pixel / 2, bottom, -pixel)
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    source: RasterMap | None = raster_map
    if (right - left) * (top - bottom) / raster_map.resolution**2 <= MAX_SMOOTHED_CELLS:
        source = raster_map.crop(points[[0, len(x) - 1, -len(x), -1]], margin=0.0, cell=pixel)
    if source is None:
        axes.set_facecolor(NO_MAP)
        return
    grey, known = source.sample(points)
    picture = np.where(known, grey, np.nan).reshape(len(y), len(x))
    colours = mpl.colormaps['gray'].with_extremes(bad=NO_MAP)
    axes.imshow(picture, cmap=colours, extent=(left, right, bottom, top), alpha=0.75,
                vmin=np.nanpercentile(picture, 0.5) if known.any() else 0.0,
                vmax=np.nanpercentile(picture, 99.5) if known.any() else 1.0)


def _draw_ellipses(axes: Axes, run: Run, table: ErrorTable,
                   box: tuple[float, float, float, float]) -> int | None:
    """Draw at most `ELLIPSES` ellipses; return their enlargement, or None if there are none."""
    rows = [row for row, estimate in enumerate(run.estimates)
            if estimate.pose is not None and estimate.covariance is not None]
    if not rows:
        return None
    rows = [rows[i] for i in np.unique(np.linspace(0, len(rows) - 1, ELLIPSES).astype(int))]
    shapes = np.array([_ellipse(np.asarray(run.estimates[row].covariance)) for row in rows])
    wanted = 0.08 * max(box[2] - box[0], box[3] - box[1])
    ratio = wanted / max(float(np.median(shapes[:, 0])), 1e-9)
    factor = int(10 ** np.clip(np.floor(np.log10(max(ratio, 1.0))), 0, 4))
    factor *= 5 if ratio / factor >= 5.0 else 2 if ratio / factor >= 2.0 else 1
    axes.add_collection(EllipseCollection(
        shapes[:, 0] * factor, shapes[:, 1] * factor, shapes[:, 2], units='xy',
        offsets=table.poses[rows, :2], offset_transform=axes.transData,
        facecolors='none', edgecolors=ELLIPSE, linewidths=0.9, zorder=4,
    ))
    return factor


def _ellipse(covariance: Floats) -> tuple[float, float, float]:
    """Return width and height (full axes, metres) and angle (degrees) of the 95 % ellipse."""
    variances, axes = np.linalg.eigh(covariance[:2, :2])
    small, large = 2.0 * np.sqrt(np.maximum(variances, 0.0) * ELLIPSE_95)
    return float(large), float(small), float(np.degrees(np.arctan2(axes[1, 1], axes[0, 1])))
