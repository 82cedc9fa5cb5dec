# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The charts of the report, as matplotlib figures that need no display."""

from __future__ import annotations

from collections.abc import Mapping

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from gip_localizer.evaluation.error_table import ErrorTable
from gip_localizer.evaluation.run import Surface
from gip_localizer.visualization.style import BAND, ESTIMATE, TRUTH, WRONG

Floats = NDArray[np.float64]
NEES_95 = (0.2157952826238981, 9.348403604496145)
"""2.5 % and 97.5 % quantiles of the chi-square law with 3 degrees of freedom (no unit)."""
SIZE = (4.8, 4.2)
"""Width and height of a chart, inches; chosen."""
SMALL = (3.4, 2.7)
"""Width and height of a score surface, inches; chosen."""


def seconds(table: ErrorTable) -> Floats:
    """Return times since the first frame, (n,) seconds."""
    stamps = table.stamps_ns
    return (stamps - stamps.min()) * 1e-9 if len(stamps) else np.empty(0)


def error_figure(table: ErrorTable, links: Mapping[int, str]) -> Figure:
    """
    Draw longitudinal, lateral and yaw error over time, with the band of ±3σ.

    Parameters
    ----------
    table : ErrorTable
        The errors.
    links : dict
        Stamp (ns) → address to which a circle about the frame leads.

    """
    figure = Figure(figsize=SIZE)
    panels = figure.subplots(3, 1, sharex=True)
    time, order = _in_time(table)
    rows = ((0, 1e3, 'longitudinal [mm]'), (1, 1e3, 'lateral [mm]'),
            (2, 180.0 / np.pi, 'yaw [deg]'))
    for axes, (column, scale, label) in zip(panels, rows, strict=True):
        error, sigma = table.body[order, column] * scale, table.sigma[order, column] * scale
        axes.fill_between(time, -3 * sigma, 3 * sigma, color=BAND, alpha=0.5, lw=0, label='±3σ')
        axes.plot(time, error, color=ESTIMATE, lw=1.0, marker='.', ms=3, label='error')
        axes.axhline(0.0, color='0.4', lw=0.6)
        axes.set_ylabel(label)
        _limit(axes, error, 3 * sigma)
        _mark_withheld(axes, table)
        _link(axes, table, table.body[:, column] * scale, links)
    panels[0].legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=3, fontsize=9)
    panels[-1].set_xlabel('time since the first frame [s]')
    return figure


def nees_figure(table: ErrorTable) -> Figure:
    """Draw NEES over time, with the band that holds 95 % of frames with true covariances."""
    figure = Figure(figsize=(SIZE[0], 2.7))
    axes = figure.subplots()
    time, order = _in_time(table)
    nees = np.maximum(table.nees[order], 1e-3)
    known = nees[np.isfinite(nees)]
    axes.axhspan(*NEES_95, color=BAND, alpha=0.4, lw=0, label='95 % if covariances are true')
    axes.plot(time, nees, '.', color=ESTIMATE, ms=4, label='frame')
    axes.axhline(3.0, color=TRUTH, lw=1.0, label='expected mean 3')
    if len(known):
        axes.axhline(known.mean(), color=WRONG, ls='--', lw=1.0, label=f'mean {known.mean():.2f}')
    axes.set(yscale='log', xlabel='time since the first frame [s]', ylabel='NEES')
    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=9)
    return figure


def latency_figure(latencies: Floats) -> Figure:
    """Draw the histogram of latencies (ms) with p50, p95 and p99."""
    figure = Figure(figsize=(SIZE[0], 2.4))
    axes = figure.subplots()
    axes.hist(latencies, bins=min(40, max(5, len(latencies) // 4)), color=ESTIMATE, alpha=0.8)
    for percent, style in ((50, '-'), (95, '--'), (99, ':')):
        value = float(np.percentile(latencies, percent))
        axes.axvline(value, color=WRONG, ls=style, lw=1.2, label=f'p{percent} {value:.1f} ms')
    axes.set(xlabel='latency of a frame [ms]', ylabel='frames')
    axes.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=9)
    return figure


def surface_figure(surface: Surface) -> Figure:
    """Draw the correlation over the offsets from the centre of the search window."""
    figure = Figure(figsize=SMALL)
    axes = figure.subplots()
    axes.grid(False)
    picture = axes.imshow(
        surface.values, cmap='viridis', interpolation='nearest', aspect='equal',
        extent=(surface.left_m, -surface.left_m, -surface.ahead_m, surface.ahead_m),
    )
    axes.set(xlabel='left [m]', ylabel='ahead [m]')
    figure.colorbar(picture, label='correlation')
    return figure


def _in_time(table: ErrorTable) -> tuple[Floats, NDArray[np.intp]]:
    time = seconds(table)
    order = np.argsort(time, kind='stable')
    return time[order], order


def _limit(axes: Axes, *series: Floats) -> None:
    """Set the vertical range to nearly all frames; single outliers may lie outside."""
    sizes = [np.abs(values[np.isfinite(values)]) for values in series]
    tops = [float(np.percentile(values, 99.5)) for values in sizes if len(values)]
    top = max(tops, default=1.0) * 1.2
    if top > 0.0:
        axes.set_ylim(-top, top)


def _link(axes: Axes, table: ErrorTable, error: Floats, links: Mapping[int, str]) -> None:
    """Draw circles that are links; withheld frames have theirs at zero."""
    rows = [row for row, stamp in enumerate(table.stamps_ns) if int(stamp) in links]
    circles = axes.scatter(
        seconds(table)[rows], np.nan_to_num(error[rows]), s=45, facecolors='#ffffff01',
        edgecolors=WRONG, linewidths=0.9, zorder=5,
    )
    circles.set_urls([links[int(table.stamps_ns[row])] for row in rows])


def _mark_withheld(axes: Axes, table: ErrorTable) -> None:
    times = seconds(table)[~table.published]
    if len(times):
        axes.plot(times, np.zeros(len(times)), '|', color=WRONG, ms=5, label='withheld')


