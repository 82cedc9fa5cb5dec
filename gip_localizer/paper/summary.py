# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The table that `gip paper` prints: metric, value, unit."""

from __future__ import annotations

from collections.abc import Sequence
import math

import numpy as np

from gip_localizer.paper.baseline_comparison import METHODS, TASKS
from gip_localizer.paper.baseline_results import BeyondPoint
from gip_localizer.paper.curves import Curves, GAIN_AT, NAMES
from gip_localizer.paper.image_experiment import RECTIFIERS
from gip_localizer.paper.image_results import PipelinePoint

Row = tuple[str, str, str]
SHOWN = (0, 9, 49, 99)
"""Indices of the printed amplitudes: a = 0.1, 1, 5 and 10; chosen."""
GOOD_RATE = 0.9
"""Success rate from which a method counts as reliable; chosen."""


def curve_rows(curves: Curves) -> list[Row]:
    """Return the numbers of the simulated figure."""
    rows = [('squares', f'{curves.squares.total}', '')]
    for k in SHOWN:
        for name in NAMES:
            exact = getattr(curves, name).exact[k]
            rows.append((f'error at a = {curves.amplitudes[k]:g}, {name}', f'{exact:.6e}', ''))
    for probability, gain in zip(GAIN_AT, curves.gains_db, strict=True):
        value = ('not reached', '') if math.isnan(gain) else (f'{gain:.2f}', 'dB')
        rows.append((f'gain at error {probability:g}', *value))
    for name in NAMES:
        curve, count = getattr(curves, name), len(curves.amplitudes)
        rows.append((f'samples outside their 99.9 % band, {name}', f'{curve.outside} of {count}',
                     ''))
        if curves.is_paper:
            rows.append((f'RMS of (printed - exact) / standard error, {name}',
                         f'{curve.printed_rms:.3f}', ''))
    return rows


def pipeline_rows(points: Sequence[PipelinePoint]) -> list[Row]:
    """Return the number of amplitudes at which the theory lies in the measured interval."""
    rows = []
    for how in RECTIFIERS:
        for name in NAMES:
            chosen = [p for p in points if p.inner_product == name and p.rectifier == how]
            inside = sum(p.agrees for p in chosen)
            rows.append((f'images agree with theory, {how}, {name}',
                         f'{inside} of {len(chosen)}', ''))
    return rows


def beyond_rows(points: Sequence[BeyondPoint]) -> list[Row]:
    """Return the amplitude from which each method succeeds in 90 % of the frames."""
    rows = []
    for task in TASKS:
        for method in METHODS:
            chosen = [p for p in points if p.task == task.name and p.method == method]
            a = reliable_from(chosen)
            value = 'never' if math.isnan(a) else f'a = {a:.3g}'
            rows.append((f'90 % of frames found, {task.name}: {method}', value, ''))
    return rows


def reliable_from(points: Sequence[BeyondPoint]) -> float:
    """Return the amplitude from which the rate stays at least 0.9; NaN if there is none."""
    ordered = sorted(points, key=lambda point: point.amplitude)
    rates = np.array([point.rate for point in ordered])
    log_a = np.log([point.amplitude for point in ordered])
    bad = np.flatnonzero(rates < GOOD_RATE)
    if bad.size == 0:
        return float(np.exp(log_a[0]))
    last = int(bad[-1])
    if last == len(ordered) - 1:
        return math.nan
    share = (GOOD_RATE - rates[last]) / (rates[last + 1] - rates[last])
    return float(np.exp(log_a[last] + share * (log_a[last + 1] - log_a[last])))


def format_rows(rows: Sequence[Row]) -> str:
    """Return the rows as aligned text."""
    width = max(len(metric) for metric, _, _ in rows)
    return '\n'.join(
        f'{metric:<{width}}  {value:>13} {unit}'.rstrip() for metric, value, unit in rows
    )
