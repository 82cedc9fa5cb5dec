# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip evaluate`: accuracy and integrity on rendered frames, compared with bounds."""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.evaluation.suites.output import Evaluation

SUITES = ('conditions', 'model-error', 'integrity', 'cmrnet', 'bound', 'relocalize', 'lane')
DEFAULT_OUT = Path('results/evaluate')


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'evaluate', help='accuracy and integrity on rendered frames; fails if a bound is missed',
        description='Localize rendered frames under many conditions and compare the poses with '
                    'the truth. The exit status is 1 if a bound is missed.',
    )
    parser.add_argument('--suite', action='append', choices=(*SUITES, 'all'), dest='suites',
                        help='suite to run; repeatable (default: all)')
    parser.add_argument('--frames', type=_count, default=30, metavar='N',
                        help='frames per condition (default: %(default)s)')
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of worlds, places, starts and noise (default: 0)')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE',
                        dest='settings', help='a parameter of the localizer; repeatable')
    parser.add_argument('--jobs', type=_count, default=min(os.cpu_count() or 1, 8), metavar='N',
                        help='number of processes (default: %(default)s)')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'results folder (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace existing results in --out')
    parser.set_defaults(run=run)


def _count(words: str) -> int:
    number = int(words) if words.isdecimal() else 0
    if number < 1:
        raise argparse.ArgumentTypeError(f'expected a whole number above 0, got {words}')
    return number


def run(args: argparse.Namespace) -> int:
    """Run the suites, print the tables, write the folder; return 1 if a bound is missed."""
    from gip_localizer.evaluation.suites.output import MARK, write_evaluation
    from gip_localizer.evaluation.suites.tables import format_section
    from gip_localizer.io.output_folder import check_folder

    check_folder(args.out, force=args.force, mark=MARK)
    found = _evaluate(args)
    write_evaluation(args.out, found, force=args.force)
    for section in found.sections:
        print(format_section(section), end='\n\n')
    print(f'results in {args.out}, report: {args.out / "report.html"}')
    for line in found.missed:
        print(f'gip evaluate: missed: {line}', file=sys.stderr)
    return 1 if found.missed else 0


def _evaluate(args: argparse.Namespace) -> Evaluation:
    from gip_localizer.cli.progress import progress
    from gip_localizer.cli.settings import parse_settings
    from gip_localizer.errors import ParameterError
    from gip_localizer.evaluation.suites.output import Evaluation
    from gip_localizer.evaluation.suites.runner import Job, jobs, run_all
    from gip_localizer.evaluation.suites.runner import SUITES as BY_NAME
    from gip_localizer.parameters import Parameters

    if not 0 <= args.seed < 2**31:
        raise ParameterError(f'--seed {args.seed}: expected 0 to 2147483647')
    requested = parse_settings(args.settings, Parameters)
    values = Parameters().replace(requested).to_dict()  # refuses what the workers would refuse
    changes = {name: values[name] for name in requested}
    asked = args.suites or ['all']
    names = SUITES if 'all' in asked else tuple(n for n in SUITES if n in asked)
    work = jobs(names, frames=args.frames, seed=args.seed, overrides=changes)
    with progress(sum(job.count for job in work), 'evaluating', unit='trial') as bar:
        def done(job: Job) -> None:
            bar.set_postfix_str(f'{job.suite}: {job.part}', refresh=False)
            bar.update(job.count)

        records = run_all(work, processes=args.jobs, done=done)
    sections = [
        BY_NAME[name].summarise([r for r in records if r.suite == name]) for name in names
    ]
    settings = {'seed': args.seed, 'frames_per_condition': args.frames, 'parameters': changes}
    return Evaluation(settings, sections, records)
