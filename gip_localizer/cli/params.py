# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip params`: every parameter, as a ROS parameter file or a table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gip_localizer.errors import OutputError

BEGIN = '<!-- parameters: written by `make params` -->'
END = '<!-- end of parameters -->'


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser('params', help='all parameters, with defaults, ranges and units')
    parser.add_argument(
        '--node', choices=('localizer', 'synthetic_camera'), default='localizer',
        help='whose parameters (default: localizer)',
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='as a ROS parameter file (default)')
    form.add_argument('--markdown', action='store_true', help='as a table')
    form.add_argument(
        '--write', type=Path, metavar='ROOT',
        help='write config/*.yaml and the table of README.md below the source tree ROOT',
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print or write parameters."""
    from gip_localizer.evaluation.parameter_pages import markdown_table, parameter_file, tree_of

    if args.write is not None:
        _write(args.write)
    elif args.markdown:
        print(markdown_table(tree_of(args.node)))
    else:
        print(parameter_file(tree_of(args.node)), end='')
    return 0


def _write(root: Path) -> None:
    from gip_localizer.evaluation.parameter_pages import markdown_table, parameter_file, tree_of

    readme = root / 'README.md'
    text = readme.read_text(encoding='utf-8') if readme.is_file() else ''
    if BEGIN not in text or END not in text:
        raise OutputError(f'{readme}: lacks the lines {BEGIN!r} and {END!r}; is ROOT the sources?')
    before, rest = text.split(BEGIN, 1)
    after = rest.split(END, 1)[1]
    table = markdown_table(tree_of('localizer'))
    readme.write_text(f'{before}{BEGIN}\n{table}\n{END}{after}', encoding='utf-8')
    for node in ('localizer', 'synthetic_camera'):
        path = root / 'config' / f'{node}.yaml'
        path.write_text(parameter_file(tree_of(node)), encoding='utf-8')
        print(f'wrote {path}')
    print(f'wrote {readme}')
