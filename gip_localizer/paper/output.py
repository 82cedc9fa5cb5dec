# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Write the tables of `gip paper`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
import csv
from pathlib import Path

from gip_localizer.paper.curves import Curves

CURVES_FILE = 'curves.csv'
CURVES_COLUMNS = (
    'amplitude', 'standard_exact', 'generalized_exact', 'standard_sampled',
    'generalized_sampled', 'standard_paper', 'generalized_paper',
)


def write_table(path: Path, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
    """Write a CSV file; floats have ten significant digits, NaN is an empty field."""
    with path.open('w', encoding='utf-8', newline='') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(columns)
        writer.writerows([_field(value) for value in row] for row in rows)


def _field(value: object) -> str:
    if not isinstance(value, float):
        return str(value)
    return '' if value != value else f'{value:.10g}'


def write_curves(path: Path, curves: Curves) -> None:
    """Write `curves.csv`, one row per amplitude."""
    standard, generalized = curves.standard, curves.generalized
    columns = (
        curves.amplitudes, standard.exact, generalized.exact, standard.sampled,
        generalized.sampled, standard.printed, generalized.printed,
    )
    rows = zip(*(column.tolist() for column in columns), strict=True)
    write_table(path, CURVES_COLUMNS, rows)
