# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The tables of an evaluation as text, as CSV rows and as data for JSON."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import math
from typing import Any

import numpy as np

from gip_localizer.evaluation.suites.suite import Cell, Record, Section

FIGURES = (
    'confidence', 'margin', 'lattice_correlation', 'agreement', 'overdispersion', 'winner_mass',
)
COLUMNS = (
    'suite', 'part', 'index', 'kind', 'status', 'ahead_m', 'left_m', 'yaw_rad', 'raw_ahead_m',
    'raw_left_m', 'raw_yaw_rad', 'sigma_ahead_m', 'sigma_left_m', 'sigma_yaw_rad', 'nees',
    *FIGURES, 'milliseconds',
)


def text(cell: Cell) -> str:
    """Return a cell as text; NaN and infinity become a dash."""
    if isinstance(cell, float):
        return f'{cell:g}' if math.isfinite(cell) else '-'
    return str(cell)


def format_section(section: Section) -> str:
    """Return a section as aligned text, followed by its missed bounds."""
    lines = [[text(cell) for cell in line] for line in (section.columns, *section.rows)]
    wide = [max(len(line[k]) for line in lines) for k in range(len(section.columns))]
    table = [
        '  '.join(
            cell.ljust(width) if k == 0 else cell.rjust(width)
            for k, (cell, width) in enumerate(zip(line, wide, strict=True))
        ).rstrip()
        for line in lines
    ]
    missed = [f'  MISSED {bound}' for bound in section.bounds if not bound.met]
    verdict = f'  {len(section.bounds) - len(missed)} of {len(section.bounds)} bounds met'
    return '\n'.join([section.title, *table, verdict, *missed])


def record_rows(records: Sequence[Record]) -> Iterator[list[object]]:
    """Yield the rows of `evaluation.csv` (columns: `COLUMNS`), one per trial."""
    for record in records:
        trial = record.trial
        variances = None if trial.covariance is None else np.diag(trial.covariance)
        sigmas = None if variances is None else np.sqrt(variances)
        yield [
            record.suite, record.part, record.index, record.kind, trial.status,
            *_three(trial.error), *_three(trial.raw_error), *_three(sigmas),
            _number(trial.nees), *(_number(trial.quality.get(name)) for name in FIGURES),
            f'{trial.milliseconds:.1f}',
        ]


def _three(values: Any) -> list[str]:
    return [''] * 3 if values is None else [_number(float(value)) for value in values]


def _number(value: float | None) -> str:
    return '' if value is None or not math.isfinite(value) else f'{value:.9g}'


def section_data(section: Section) -> dict[str, Any]:
    """Return a section as data for JSON."""
    return {
        'title': section.title,
        'columns': list(section.columns),
        'rows': [[_json(cell) for cell in row] for row in section.rows],
        'bounds': [
            {'row': b.row, 'what': b.what, 'value': _json(b.value), 'limit': _json(b.limit),
             'at_most': b.at_most, 'met': b.met}
            for b in section.bounds
        ],
        'notes': list(section.notes),
    }


def _json(value: Cell) -> Cell | None:
    """Return a cell for JSON, which has neither NaN nor infinity."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def totals(records: Sequence[Record]) -> dict[str, int]:
    """Return the numbers of frames, of frames from right starts, and of wrong poses."""
    near = [r for r in records if r.suite != 'integrity' or r.kind == 'right']
    frames = {(r.suite, r.part, r.index) for r in records}
    return {
        'frames': len(frames),
        'frames_from_right_starts': len({(r.suite, r.part, r.index) for r in near}),
        'wrong_poses_from_right_starts': sum(r.trial.wrong for r in near),
        'wrong_poses': sum(r.trial.wrong for r in records),
        'faults': sum(r.trial.faulty for r in records),
    }
