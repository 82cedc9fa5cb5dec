# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip replay`: run a bag through the localizer and evaluate the poses."""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
import re
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.evaluation.wrong_bounds import DEFAULT_BOUNDS, WrongBounds
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.cli.replay_input import ReplayInput
    from gip_localizer.core.estimate import Estimate
    from gip_localizer.evaluation.replay import Replay

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 plus the number of SIGINT, as shells report it."""
DEFAULT_OUT = Path('results/replay')
NO_POSE = 1
"""Exit status if no frame gave a pose."""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'replay', help='localize every frame of a bag, without ROS',
        description='Localize every frame of a bag and write metrics, report, trajectories and '
                    'a table of the frames. Exit status: 0 if at least one frame gave a pose.',
    )
    # A pose that begins with a minus sign is a value, not an option.
    parser._negative_number_matcher = re.compile(r'^-[\d.].*$')
    parser.add_argument('bag', nargs='+', type=user_path, metavar='BAG',
                        help='rosbag2 folder, .mcap or .db3 file; several bags are several runs '
                             'with results in DIR/NAME, unless they are parts of one recording')
    parser.add_argument('--map', type=user_path, metavar='YAML',
                        help='nav2 map YAML (default: map_file of --params, or map.yaml next to '
                             'the bag)')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'results folder (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace existing results in --out')
    parser.add_argument('--no-report', dest='report', action='store_false',
                        help='do not write report.html, which takes about a second')
    tune = parser.add_argument_group('parameters')
    tune.add_argument('--params', type=user_path, metavar='FILE',
                      help='ROS parameter YAML (default: params.yaml next to the bag, if any)')
    tune.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', dest='settings',
                      help='one parameter; repeatable, e.g. --set search.x=1.0')
    tune.add_argument('--metric', help='short for --set score.metric=METRIC')
    tune.add_argument('--initial-pose', metavar='X,Y,YAW',
                      help='metres and radians in the map frame, or the word truth: the ground '
                           'truth at the first image that is replayed')
    tune.add_argument('--relocalize', action='store_true',
                      help='start without a pose: search the whole map at the first image')
    judge = parser.add_argument_group('a published pose is wrong if an error exceeds')
    judge.add_argument('--wrong-xy', type=float, default=DEFAULT_BOUNDS.xy_m, metavar='M',
                       help='metres (default: %(default)s)')
    judge.add_argument('--wrong-yaw', type=float, default=DEFAULT_BOUNDS.yaw_deg, metavar='DEG',
                       help='degrees (default: %(default)s)')
    topics = parser.add_argument_group('topics', 'found by type if it is unique')
    topics.add_argument('--image-topic', metavar='TOPIC')
    topics.add_argument('--camera-info-topic', metavar='TOPIC')
    topics.add_argument('--odom-topic', metavar='TOPIC')
    topics.add_argument('--no-odometry', action='store_true',
                        help='do not use the odometry of the bag')
    topics.add_argument('--mask-topic', metavar='TOPIC',
                        help='masks of the images, paired by stamp (sets mask.from_topic)')
    topics.add_argument('--ground-truth', metavar='TOPIC|FILE',
                        help='topic of the bag, or a TUM file (base in the map frame)')
    part = parser.add_argument_group('part of the bag')
    part.add_argument('--start', type=float, default=0.0, metavar='S',
                      help='start time in seconds after the first message')
    part.add_argument('--duration', type=float, metavar='S', help='length in seconds')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Replay each recording, write its results folder, print its table."""
    from gip_localizer.cli.replay_input import check_options
    from gip_localizer.evaluation.results import check_output
    from gip_localizer.io.bags.recordings import recordings

    check_options(args)
    bounds = WrongBounds(args.wrong_xy, args.wrong_yaw)
    groups = recordings(args.bag, args.image_topic)
    outs = [args.out] if len(groups) == 1 else [args.out / name for name in _names(groups)]
    for out in outs:
        check_output(out, args.force)
    codes = []
    for number, (paths, out) in enumerate(zip(groups, outs, strict=True), start=1):
        if len(groups) > 1:
            print(f'run {number} of {len(groups)}: {", ".join(map(str, paths))}', flush=True)
        codes.append(_replay(args, paths, out, bounds))
        if codes[-1] == INTERRUPTED:
            return INTERRUPTED
    if len(groups) > 1:
        print(f'\ncompare the runs with: gip compare {" ".join(map(str, outs))}')
    return max(codes)


def _names(groups: Sequence[Sequence[Path]]) -> list[str]:
    """Return the name of each recording's first bag, numbered where it is not unique."""
    names = [paths[0].absolute().name.split('.')[0] for paths in groups]
    counts, seen = Counter(names), Counter[str]()
    for index, name in enumerate(names):
        seen[name] += 1
        if counts[name] > 1:
            names[index] = f'{name}_{seen[name]}'
    return names


def _replay(
    args: argparse.Namespace, paths: Sequence[Path], out: Path, bounds: WrongBounds
) -> int:
    """Replay one recording; return its exit status."""
    from gip_localizer.cli.replay_input import open_input
    from gip_localizer.cli.settings import ctrl_c
    from gip_localizer.evaluation.metrics import format_table, table_rows
    from gip_localizer.evaluation.no_pose import no_pose_advice
    from gip_localizer.evaluation.replay import Replay
    from gip_localizer.evaluation.results import write_results
    from gip_localizer.io.bags.topics import TRUTH
    from gip_localizer.io.map_files import load_map

    given = open_input(args, paths)
    replay = Replay(given.bag, given.topics, load_map(given.parameters.map_file),
                    given.parameters, given.truth, bounds, args.relocalize)
    with ctrl_c(interrupts=True):
        _with_progress(replay, given)
    with ctrl_c(interrupts=False):  # the results so far are written first
        result = replay.result(f'Replay of {paths[0].name}', given.sources, given.notes)
        metrics = write_results(out, result, args.force, report=args.report)
    for note in result.notes:
        print(f'gip: {note}', file=sys.stderr)
    if result.truth is None:
        print('gip: no ground truth, errors are unknown; name a TUM file or a topic with '
              f'--ground-truth (types: {", ".join(TRUTH)})', file=sys.stderr)
    print(format_table(table_rows(metrics)))
    print(f'\nresults in {out}' + (f', report: {out / "report.html"}' if args.report else ''))
    if not replay.complete:
        print('gip: stopped; the results are marked incomplete', file=sys.stderr)
        return INTERRUPTED
    if advice := no_pose_advice(result.estimates):
        print(f'gip: {advice}', file=sys.stderr)
        return NO_POSE
    return 0


def _with_progress(replay: Replay, given: ReplayInput) -> None:
    from gip_localizer.cli.progress import progress

    total = round(given.topics.image.messages * given.window.share(given.bag))
    with progress(total, 'replaying') as bar:
        fixes = 0

        def show(estimate: Estimate) -> None:
            nonlocal fixes
            fixes += estimate.published
            bar.set_postfix_str(f'{fixes} fixes, {estimate.status}', refresh=False)
            bar.update()

        replay.run(given.window, show)
