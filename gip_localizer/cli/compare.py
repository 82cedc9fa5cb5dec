# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip compare`: compare results folders."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from gip_localizer.parameters.yaml_files import user_path

DEFAULT_OUT = Path('results/compare')
MARK = 'compare.html'


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'compare', help='compare results folders: metrics, parameters, one chart',
        description='Print the figures of two or more results folders next to each other, with '
                    'the parameters that differ, and draw one chart.',
    )
    parser.add_argument('runs', nargs='+', type=user_path, metavar='RUN', help='a results folder')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'folder for compare.html and compare.png (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace existing files in --out')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the tables; write the report and the figure."""
    import matplotlib as mpl

    from gip_localizer.evaluation.compare import (
        comparison_figure,
        metric_lines,
        parameter_lines,
        read_runs,
    )
    from gip_localizer.evaluation.report import figure_uri, template
    from gip_localizer.io.output_folder import fresh_folder
    from gip_localizer.visualization.style import STYLE

    runs = read_runs(args.runs)
    labels = [folder.label for folder in runs]
    tables = {'Metrics': metric_lines(runs), 'Parameters that differ': parameter_lines(runs)}
    with fresh_folder(args.out, force=args.force, mark=MARK) as folder, mpl.rc_context(STYLE):
        comparison_figure(runs).savefig(folder / 'compare.png', dpi=150)
        page = template('compare.html.j2').render(
            labels=labels, tables=tables, figure=figure_uri(comparison_figure(runs))
        )
        (folder / MARK).write_text(page, encoding='utf-8')
    for caption, lines in tables.items():
        print(_aligned([[caption, *labels], *(lines or [['none']])]), end='\n\n')
    print(f'{args.out / MARK}, {args.out / "compare.png"}')
    return 0


def _aligned(lines: Sequence[Sequence[str]]) -> str:
    columns = max(map(len, lines))
    full = [[*line, *[''] * (columns - len(line))] for line in lines]
    wide = [max(len(line[column]) for line in full) for column in range(columns)]
    return '\n'.join(
        '  '.join([f'{line[0]:<{wide[0]}}', *(f'{cell:>{width}}' for cell, width in
                                              zip(line[1:], wide[1:], strict=True))]).rstrip()
        for line in full
    )
