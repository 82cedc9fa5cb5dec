# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip bench`: speed and results compared with OpenCV, on this machine."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.benchmark.rows import Row

SUITES = (
    'track', 'acquire', 'global', 'relocalize', 'noise', 'growth', 'rectify', 'frame', 'map',
    'node',
)
DEFAULT_OUT = Path('results/bench')
FRAMES = {'track': (1000, 200), 'acquire': (200, 20), 'global': (30, 4)}
"""Number of frames per suite, and of those that the slow search processes too; chosen."""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'bench', help='speed compared with OpenCV, and latency of the node, on this machine',
        description='Run the same searches with this package and with cv2.matchTemplate, '
                    'alternately, and write bench.json, details.json, bench.md and figures. '
                    'Stop other programs meanwhile: they slow the measurement down.',
    )
    parser.add_argument('--suite', action='append', choices=(*SUITES, 'all'), dest='suites',
                        help='what to measure; repeatable (default: all)')
    parser.add_argument('--quick', action='store_true',
                        help='few frames, for a rough result only')
    parser.add_argument('--seconds', type=float, default=60.0, metavar='S',
                        help='length of each drive of the suite node (default: 60)')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'results folder (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace existing results in --out')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, write the folder, print the table."""
    from gip_localizer.benchmark.machine import machine
    from gip_localizer.benchmark.output import as_markdown, MARK, write_bench
    from gip_localizer.cli.progress import progress
    from gip_localizer.errors import ParameterError
    from gip_localizer.io.output_folder import check_folder

    if not 1.0 <= args.seconds <= 36_000.0:
        raise ParameterError(f'--seconds {args.seconds:g}: expected 1 to 36000')
    check_folder(args.out, force=args.force, mark=MARK)
    asked = set(args.suites or ('all',))
    chosen = [suite for suite in SUITES if asked & {suite, 'all'}]
    rows: list[Row] = []
    details: dict[str, Any] = {'machine': {**machine(), 'quick': args.quick}}
    load = details['machine']['load_before'][0]
    for suite in progress(len(chosen), 'measuring', unit='suite', iterable=chosen):
        found, more = _measure(suite, args)
        rows += found
        details[suite] = more
    write_bench(args.out, rows, details, force=args.force)
    print(as_markdown(rows))
    print(f'results in {args.out}; load of the machine before: {load:.1f}')
    return 0


def _measure(suite: str, args: argparse.Namespace) -> tuple[list[Row], Any]:
    from gip_localizer.benchmark import map_area, profile, rectify, relocalize, search_rows

    if suite in FRAMES:
        frames, judged = FRAMES[suite]
        if args.quick:
            frames, judged = max(frames // 50, 2), max(judged // 20, 1)
        return search_rows.search_suite(suite, frames, judged, 1 if args.quick else 3)
    few: dict[str, Callable[[], tuple[list[Row], Any]]] = {
        'relocalize': partial(relocalize.relocalize_suite, 2 if args.quick else 20),
        'noise': partial(search_rows.noise_suite, 20 if args.quick else 400),
        'rectify': partial(rectify.rectify_suite, 50 if args.quick else 400),
        'frame': partial(profile.profile_suite, 1 if args.quick else 4),
        'map': partial(map_area.map_suite, 1 if args.quick else 3),
    }
    if suite == 'growth':
        return [], search_rows.growth_details()
    if suite in few:
        return few[suite]()
    from gip_localizer.ros.bench.latency import node_suite

    return node_suite(min(args.seconds, 8.0) if args.quick else args.seconds)
