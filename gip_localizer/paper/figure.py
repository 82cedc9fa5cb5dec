# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Fig. SimResultsD8 reproduced, with a linear axis as in the paper and a logarithmic one."""

from __future__ import annotations

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from gip_localizer.paper.curves import BAND_999, Curve, Curves, GAIN_AT, NAMES
from gip_localizer.paper.exact import equal_error_amplitude
from gip_localizer.paper.style import COLORS, LINES

LABELS = {'standard': 'standard inner product', 'generalized': 'generalized inner product'}


def curves_figure(curves: Curves) -> Figure:
    """
    Draw probability of error over amplitude.

    Parameters
    ----------
    curves : Curves
        Result of `compute_curves`.

    Returns
    -------
    Figure
        Lines: exact curves. Bands: 99.9 % of sampled points. Dots: the points printed in the
        paper, or the sampled points for another camera.

    """
    figure = Figure(figsize=(10.5, 4.4), layout='constrained')
    linear, logarithmic = figure.subplots(1, 2)
    noise = curves.camera.noise_density
    for axes in (linear, logarithmic):
        for name in NAMES:
            _draw(axes, curves, getattr(curves, name), name)
        axes.set_xlabel(f'amplitude a of the squares ±a (noise N0 = {noise:g} cm² a²)')
        axes.set_xlim(0.0, float(curves.amplitudes[-1]) * 1.01)
    linear.set_ylabel('probability of error')
    linear.set_ylim(-0.02, 0.52)
    linear.legend(loc='upper right')
    logarithmic.set_yscale('log')
    logarithmic.set_ylabel('probability of error (log)')
    _draw_gains(logarithmic, curves)
    figure.suptitle(
        f'{curves.squares.total} squares of {curves.camera.square:g} cm: exact curves, the 99.9 % '
        f'band of {curves.samples:,} sampled pairs, and {_points_label(curves)}', fontsize=10,
    )
    return figure


def _points_label(curves: Curves) -> str:
    return 'the printed points' if curves.is_paper else 'the sampled points'


def _draw(axes: Axes, curves: Curves, curve: Curve, name: str) -> None:
    a, color = curves.amplitudes, COLORS[name]
    spread = BAND_999 * curve.error
    low = np.maximum(curve.exact - spread, curve.exact * 1e-2)
    axes.fill_between(
        a, low, curve.exact + spread, color=color, alpha=0.25, lw=0,
        label=f'{name}, 99.9 % of samples',
    )
    axes.plot(a, curve.exact, LINES[name], color=color, lw=1.4, label=f'{LABELS[name]}, exact')
    points = curve.printed if curves.is_paper else curve.sampled
    axes.plot(
        a, points, 'o', color=color, ms=3.4, mfc='white', mew=0.8,
        label=f'{name}, {_points_label(curves)[4:]}',
    )


def _draw_gains(axes: Axes, curves: Curves) -> None:
    """Mark the distance between the curves at equal error."""
    for probability, gain in zip(GAIN_AT, curves.gains_db, strict=True):
        left, right = (
            equal_error_amplitude(
                probability, curves.squares, curves.camera.snr_constant, generalized=flag
            )
            for flag in (True, False)
        )
        if not right <= curves.amplitudes[-1]:
            continue
        axes.annotate(
            '', (left, probability), (right, probability),
            arrowprops={'arrowstyle': '<->', 'color': '0.25', 'lw': 1.0},
        )
        axes.annotate(
            f'{gain:.2f} dB', (right, probability), (6, 3), textcoords='offset points',
            fontsize=8.5, color='0.25',
        )
