# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`frames.csv`: one row per frame with everything that is known of it, for spreadsheets."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import csv
from io import StringIO
import math

from gip_localizer.evaluation.error_table import ErrorTable
from gip_localizer.evaluation.metrics import latency_ms, status_word
from gip_localizer.evaluation.run import FrameResult, Run
from gip_localizer.io.trajectory import stamp_text

Cells = dict[str, str]
POSE = ('x_m', 'y_m', 'yaw_rad')
SIGMA = ('sigma_longitudinal_m', 'sigma_lateral_m', 'sigma_yaw_rad')
ERROR = ('error_longitudinal_m', 'error_lateral_m', 'error_yaw_rad')
FIRST = ('frame', 'stamp', 'status', 'reason', *POSE, *SIGMA, *ERROR, 'nees', 'total_ms')
QUALITY = 'quality.'
"""Prefix of quality figures, of which some are named like other columns."""


def frame_table(run: Run, table: ErrorTable) -> str:
    """
    Return the frames of a run as CSV (RFC 4180, comma, UTF-8).

    Parameters
    ----------
    run : Run
        Every frame in order.
    table : ErrorTable
        Result of `tabulate_errors` for the same frames.

    Returns
    -------
    str
        A header, then one line per frame. Columns: number (from 1), stamp [s], status, reason,
        published pose in the map frame, standard deviations and errors in the axes of the true
        pose (of the estimated one where the truth is unknown), NEES, milliseconds in total and by
        stage, and every quality figure as `quality.NAME`. What is unknown is empty.

    """
    rows = [_row(number, frame, table) for number, frame in enumerate(run.estimates)]
    stages = _names(frame.timings_ms for frame in run.estimates)
    figures = _names(frame.quality for frame in run.estimates)
    columns = [*FIRST, *(f'{stage}_ms' for stage in stages if stage != 'total'),
               *(f'{QUALITY}{name}' for name in figures)]
    text = StringIO()
    writer = csv.DictWriter(text, columns, restval='', lineterminator='\n')
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()


def _names(mappings: Iterable[Mapping[str, float]]) -> list[str]:
    """Return all keys in the order in which they occur first."""
    return list(dict.fromkeys(name for mapping in mappings for name in mapping))


def _row(number: int, frame: FrameResult, table: ErrorTable) -> Cells:
    groups = ((POSE, table.poses), (SIGMA, table.sigma), (ERROR, table.body))
    total = latency_ms(frame)
    return {
        'frame': str(number + 1),
        'stamp': stamp_text(frame.stamp_ns),
        'status': status_word(frame),
        'reason': frame.reason,
        **{name: _fixed(float(value)) for names, values in groups
           for name, value in zip(names, values[number], strict=True)},
        'nees': _fixed(float(table.nees[number])),
        **{f'{stage}_ms': f'{value:.3f}' for stage, value in frame.timings_ms.items()},
        'total_ms': '' if total is None else f'{total:.3f}',
        **{f'{QUALITY}{name}': f'{value:.6g}' for name, value in frame.quality.items()},
    }


def _fixed(value: float) -> str:
    """Return a number with a micrometre's (or microradian's) resolution; '' if unknown."""
    return f'{value:.6f}' if math.isfinite(value) else ''
