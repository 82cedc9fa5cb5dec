# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip params`: print every parameter as a ROS parameter file or as a table."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from gip_localizer.errors import OutputError
from gip_localizer.parameters.yaml_files import user_path


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'params', help='all parameters, with defaults, ranges and units',
        description='Print the parameters of an executable, or write the files of the project.',
    )
    parser.add_argument(
        '--node', choices=('localizer', 'synthetic_camera', 'bag_player'), default='localizer',
        help='node whose parameters are printed (default: localizer)',
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument('--yaml', action='store_true', help='as a ROS parameter file (default)')
    form.add_argument('--markdown', action='store_true', help='as a table')
    form.add_argument(
        '--write', type=user_path, metavar='ROOT',
        help='write the parameter files in config/ and the pages docs/parameters.md and '
        'docs/diagnostics.md of the source tree ROOT',
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the parameters, or write the generated files."""
    from gip_localizer.cli.parameter_pages import markdown_table, parameter_file, tree_of

    if args.write is not None:
        _write(args.write)
    elif args.markdown:
        print(markdown_table(tree_of(args.node)))
    else:
        print(parameter_file(tree_of(args.node)), end='')
    return 0


def _write(root: Path) -> None:
    from gip_localizer.cli.parameter_pages import generated_pages

    if not (root / 'package.xml').is_file():
        raise OutputError(
            f'{root}: holds no package.xml; expected the source tree of this package'
        )
    for name, text in generated_pages().items():
        (root / name).write_text(text, encoding='utf-8')
        print(f'wrote {root / name}')
