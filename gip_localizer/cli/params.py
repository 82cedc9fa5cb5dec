# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip params`: every parameter, as a ROS parameter file or a table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gip_localizer.errors import OutputError

TABLES = ('parameters', 'diagnostics')
"""Of README.md, each between two marks."""


def _marks(table: str) -> tuple[str, str]:
    return f'<!-- {table}: written by `make params` -->', f'<!-- end of {table} -->'


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser('params', help='all parameters, with defaults, ranges and units')
    parser.add_argument(
        '--node', choices=('localizer', 'synthetic_camera', 'bag_player'), default='localizer',
        help='whose parameters (default: localizer)',
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='as a ROS parameter file (default)')
    form.add_argument('--markdown', action='store_true', help='as a table')
    form.add_argument(
        '--write', type=Path, metavar='ROOT',
        help='write config/*.yaml and the tables of README.md below the source tree ROOT',
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print or write parameters."""
    from gip_localizer.cli.parameter_pages import markdown_table, parameter_file, tree_of

    if args.write is not None:
        _write(args.write)
    elif args.markdown:
        print(markdown_table(tree_of(args.node)))
    else:
        print(parameter_file(tree_of(args.node)), end='')
    return 0


def _write(root: Path) -> None:
    from gip_localizer.cli.parameter_pages import markdown_table, parameter_file, tree_of
    from gip_localizer.session.diagnostic_rules import diagnostics_table

    readme = root / 'README.md'
    text = readme.read_text(encoding='utf-8') if readme.is_file() else ''
    tables = (markdown_table(tree_of('localizer')), diagnostics_table())
    for name, table in zip(TABLES, tables, strict=True):
        text = _with_table(readme, text, name, table)
    readme.write_text(text, encoding='utf-8')
    for node in ('localizer', 'synthetic_camera'):
        path = root / 'config' / f'{node}.yaml'
        path.write_text(parameter_file(tree_of(node)), encoding='utf-8')
        print(f'wrote {path}')
    print(f'wrote {readme}')


def _with_table(readme: Path, text: str, name: str, table: str) -> str:
    begin, end = _marks(name)
    if begin not in text or end not in text:
        raise OutputError(f'{readme}: lacks the lines {begin!r} and {end!r}; is ROOT the sources?')
    before, rest = text.split(begin, 1)
    after = rest.split(end, 1)[1]
    return f'{before}{begin}\n{table}\n{end}{after}'
