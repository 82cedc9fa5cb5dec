# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of the experiments on images: the paper's experiment, and the task of a vehicle."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullLocator
import numpy as np

from gip_localizer.paper.baseline_comparison import METHODS, TASKS
from gip_localizer.paper.baseline_results import BeyondPoint
from gip_localizer.paper.image_experiment import FORMULAS, RECTIFIERS
from gip_localizer.paper.image_results import PipelinePoint
from gip_localizer.paper.style import COLORS, LINES

# Colours by Okabe and Ito, distinguishable for colour-blind readers; the paper's norm is black.
METHOD_LOOKS = {
    'generalized': ('#111111', '-', 'o'),
    'normalized generalized': ('#111111', '--', 's'),
    'standard': ('#0072b2', '-', 'o'),
    'normalized standard': ('#0072b2', '--', 's'),
    'distance decay': ('#56b4e9', ':', '^'),
    'normalized distance decay': ('#56b4e9', '-.', 'v'),
    'ORB + homography': ('#009e73', '-', 'D'),
    'phase correlation': ('#d55e00', '-', 'P'),
    'ECC': ('#cc79a7', '-', 'X'),
}


def pipeline_figure(points: Sequence[PipelinePoint]) -> Figure:
    """Draw measured error rates with 95 % intervals, and those of the theory."""
    figure = Figure(figsize=(7.2, 4.8), layout='constrained')
    axes = figure.subplots()
    for name in FORMULAS:
        rows = [p for p in points if p.inner_product == name]
        mean, sample = ([p for p in rows if p.rectifier == how] for how in RECTIFIERS)
        axes.plot(
            [p.amplitude for p in mean], [p.theory for p in mean], LINES[name],
            color=COLORS[name], lw=1.4, label=f'{name}: theory',
        )
        _draw_measured(axes, mean, 'o', COLORS[name], f'{name}: measured, footprint mean')
        _draw_measured(axes, sample, 'x', COLORS[name], f'{name}: measured, point sample')
    axes.set_yscale('log')
    axes.set_xlabel('amplitude a of the tiles ±a')
    axes.set_ylabel('probability of error (95 % intervals)')
    axes.legend(loc='lower left', fontsize=8.5)
    axes.set_title(
        f'Rendered frames with white noise, {points[0].trials:,} per amplitude', fontsize=10
    )
    return figure


def _draw_measured(
    axes: Axes, points: Sequence[PipelinePoint], marker: str, color: str, label: str
) -> None:
    rate = np.array([p.rate for p in points])
    low, high = np.array([p.interval for p in points]).T
    shown = np.where(rate > 0.0, rate, np.nan)
    axes.errorbar(
        [p.amplitude for p in points], shown, [rate - low, high - rate], fmt=marker, ms=4.5,
        mfc='white', color=color, ecolor=color, elinewidth=0.9, capsize=2.5, label=label,
    )


def beyond_figure(points: Sequence[BeyondPoint]) -> Figure:
    """Draw the success rate over the amplitude, one panel per task."""
    figure = Figure(figsize=(12.0, 5.4))
    figure.subplots_adjust(0.06, 0.26, 0.99, 0.94, wspace=0.05)
    panels = figure.subplots(1, len(TASKS), sharey=True)
    amplitudes = sorted({p.amplitude for p in points})
    for axes, task in zip(panels, TASKS, strict=True):
        for method in METHODS:
            color, line, marker = METHOD_LOOKS[method]
            rows = [p for p in points if p.task == task.name and p.method == method]
            axes.plot(
                [p.amplitude for p in rows], [p.rate for p in rows], line, color=color,
                marker=marker, ms=7.5 if 'decay' in method else 4.5, mfc='white', lw=1.3,
                label=method, zorder=2 if 'decay' in method else 3,
            )
        axes.set_xscale('log')
        axes.xaxis.set_major_locator(FixedLocator(amplitudes))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.set_xticks(amplitudes, [f'{a:g}' for a in amplitudes], rotation=60, fontsize=8)
        axes.set_title(f'unknown: {task.name}', fontsize=10)
        axes.set_xlabel('amplitude a of the tiles ±a')
    panels[0].set_ylabel(f'share of {points[0].trials} frames within half a tile of the truth')
    panels[0].set_ylim(-0.03, 1.03)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='lower center', ncols=5, fontsize=9)
    return figure
