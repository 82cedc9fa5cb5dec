# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The table of all frames in the report, which the reader filters by status without a script."""

from __future__ import annotations

from dataclasses import dataclass
import math

from gip_localizer.evaluation.error_table import ErrorTable
from gip_localizer.evaluation.metrics import latency_ms, status_word
from gip_localizer.evaluation.run import Run

MOST_ROWS = 3000
"""Largest number of frames in the report's table, so that the page stays below some megabytes;
chosen. `frames.csv` holds all."""


@dataclass(frozen=True)
class FrameRow:
    """The cells of a frame."""

    status: str
    cells: tuple[str, ...]
    reason: str


HEADINGS = ('frame', 'time [s]', 'status', 'error [mm]', 'yaw error [deg]', 'σ [mm]', 'NEES',
            'latency [ms]')


def frame_rows(run: Run, table: ErrorTable) -> list[FrameRow]:
    """Return the first `MOST_ROWS` frames; cells of unknown values are empty."""
    start = table.stamps_ns.min() if len(table.stamps_ns) else 0
    rows = []
    for number, frame in enumerate(run.estimates[:MOST_ROWS]):
        sigma = math.hypot(*(float(value) for value in table.sigma[number, :2]))
        latency = latency_ms(frame)
        status = status_word(frame)
        rows.append(FrameRow(status, (
            str(number + 1), f'{(frame.stamp_ns - start) * 1e-9:.2f}', status,
            _cell(1e3 * float(table.xy[number]), '.1f'),
            _cell(math.degrees(float(table.body[number, 2])), '+.3f'),
            _cell(1e3 * sigma, '.1f'), _cell(float(table.nees[number]), '.1f'),
            '' if latency is None else f'{latency:.1f}',
        ), frame.reason))
    return rows


def _cell(value: float, form: str) -> str:
    return format(value, form) if math.isfinite(value) else ''
