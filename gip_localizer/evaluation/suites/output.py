# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The results folder of `gip evaluate`: JSON, CSV, figures and report; complete or not at all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import csv
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

import matplotlib as mpl

from gip_localizer import __version__
from gip_localizer.evaluation.report import figure_uri, template
from gip_localizer.evaluation.suites.figures import charts
from gip_localizer.evaluation.suites.suite import Record, Section
from gip_localizer.evaluation.suites.tables import COLUMNS, record_rows, section_data, text, totals
from gip_localizer.io.output_folder import fresh_folder
from gip_localizer.parameters import Parameters
from gip_localizer.visualization.style import STYLE

MARK = 'evaluation.json'
DPI = 150
"""Resolution of figures, dots per inch; chosen."""


@dataclass(frozen=True, eq=False)
class Evaluation:
    """
    The results of an evaluation.

    Attributes
    ----------
    settings : dict
        Frames, seed and changed parameters.
    sections : sequence of Section
        One per suite.
    records : sequence of Record
        All trials.

    """

    settings: Mapping[str, Any]
    sections: Sequence[Section]
    records: Sequence[Record]

    @property
    def missed(self) -> list[str]:
        """Return one line for each missed bound and for each frame that raised an exception."""
        return [
            f'{section.name}: {bound}'
            for section in self.sections for bound in section.bounds if not bound.met
        ] + [
            f'{r.suite}: {r.part}: trial {r.index} raised an exception in the localizer'
            for r in self.records if r.trial.faulty
        ]


def write_evaluation(out: Path, found: Evaluation, *, force: bool) -> None:
    """Write the folder (raises OutputError)."""
    confidence = Parameters().replace(found.settings['parameters']).integrity.min_confidence
    with fresh_folder(out, force=force, mark=MARK) as folder, mpl.rc_context(STYLE):
        figures = charts(found.records, confidence)
        for name, figure in figures.items():
            figure.savefig(folder / f'{name}.png', dpi=DPI, metadata={'Software': None})
        _write_json(folder / MARK, found)
        _write_csv(folder / 'evaluation.csv', found.records)
        page = template('evaluate.html.j2').render(
            evaluation=found, text=text, totals=totals(found.records),
            figures={name: figure_uri(figure) for name, figure in figures.items()},
        )
        (folder / 'report.html').write_text(page, encoding='utf-8')


def _write_json(path: Path, found: Evaluation) -> None:
    content = {
        'version': __version__,
        **found.settings,
        **totals(found.records),
        'missed': found.missed,
        'suites': {section.name: section_data(section) for section in found.sections},
    }
    path.write_text(json.dumps(content, indent=1, allow_nan=False) + '\n', encoding='utf-8')


def _write_csv(path: Path, records: Sequence[Record]) -> None:
    with path.open('w', newline='', encoding='utf-8') as file:
        writer = csv.writer(file, lineterminator='\n')
        writer.writerow(COLUMNS)
        writer.writerows(record_rows(records))
