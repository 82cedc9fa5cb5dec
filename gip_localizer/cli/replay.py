# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip replay`: run a bag through the localizer and evaluate the poses."""

from __future__ import annotations

import argparse
from pathlib import Path
import re
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.core.estimate import Estimate
    from gip_localizer.core.pose import Pose2
    from gip_localizer.evaluation.replay import Replay
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.topics import Topics
    from gip_localizer.io.trajectory import Trajectory
    from gip_localizer.parameters import Parameters

INTERRUPTED = 130
"""Exit status after Ctrl-C: 128 plus the number of SIGINT, as shells report it."""
DEFAULT_OUT = Path('results/replay')


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'replay', help='localize every frame of a bag, without ROS',
        description='Localize every frame of a bag and write metrics, report and trajectories.',
    )
    # A pose that begins with a minus sign is a value, not an option.
    parser._negative_number_matcher = re.compile(r'^-[\d.].*$')
    parser.add_argument('bag', nargs='+', type=user_path, metavar='BAG',
                        help='rosbag2 folder, .mcap or .db3 file; several bags are merged by time')
    parser.add_argument('--map', type=user_path, metavar='YAML',
                        help='nav2 map YAML (default: map_file of --params, or map.yaml next to '
                             'the bag)')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'results folder (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace existing results in --out')
    tune = parser.add_argument_group('parameters')
    tune.add_argument('--params', type=user_path, metavar='FILE',
                      help='ROS parameter YAML (default: params.yaml next to the bag, if any)')
    tune.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', dest='settings',
                      help='one parameter; repeatable, e.g. --set search.x=1.0')
    tune.add_argument('--metric', help='short for --set score.metric=METRIC')
    tune.add_argument('--initial-pose', metavar='X,Y,YAW',
                      help='metres and radians in the map frame, or the word truth: the ground '
                           'truth at the first image that is replayed')
    topics = parser.add_argument_group('topics', 'found by type if it is unique')
    topics.add_argument('--image-topic', metavar='TOPIC')
    topics.add_argument('--camera-info-topic', metavar='TOPIC')
    topics.add_argument('--odom-topic', metavar='TOPIC')
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
    """Replay, write the results folder, print the table."""
    from gip_localizer.cli.settings import ctrl_c, file_next_to, unused_at_the_desk
    from gip_localizer.evaluation.metrics import format_table, table_rows
    from gip_localizer.evaluation.replay import Replay
    from gip_localizer.evaluation.results import check_output, write_results
    from gip_localizer.io.bags.camera import mounted
    from gip_localizer.io.bags.topics import TRUTH
    from gip_localizer.io.bags.window import BagWindow
    from gip_localizer.io.map_files import load_map

    check_output(args.out, args.force)
    if args.params is None:
        args.params = file_next_to(args.bag, 'params.yaml')
    window = BagWindow(args.start, args.duration)
    bag, topics, truth, notes = _open(args)
    start = _start(args, bag, topics, truth)
    parameters, said = mounted(bag, topics, _parameters(args, start))
    notes += [*said, *unused_at_the_desk(parameters)]
    replay = Replay(bag, topics, load_map(parameters.map_file), parameters, truth)
    with ctrl_c(interrupts=True):
        _with_progress(replay, window, round(topics.image.messages * window.share(bag)))
    with ctrl_c(interrupts=False):  # the results so far are written first
        result = replay.result(f'Replay of {args.bag[0].name}', _sources(args, topics), notes)
        metrics = write_results(args.out, result, args.force)
    for note in result.notes:
        print(f'gip: {note}', file=sys.stderr)
    if result.truth is None:
        print('gip: no ground truth, errors are unknown; name a TUM file or a topic with '
              f'--ground-truth (types: {", ".join(TRUTH)})', file=sys.stderr)
    print(format_table(table_rows(metrics)))
    print(f'\nresults in {args.out}, report: {args.out / "report.html"}')
    if not replay.complete:
        print('gip: stopped; the results are marked incomplete', file=sys.stderr)
        return INTERRUPTED
    return 0


def _open(args: argparse.Namespace) -> tuple[Bag, Topics, Trajectory | None, list[str]]:
    """Return bag, topics, ground truth and notes for the user."""
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.topics import choose_topics, TopicNames
    from gip_localizer.io.bags.truth import read_truth
    from gip_localizer.io.trajectory import read_tum

    asked = args.ground_truth
    is_file = asked is not None and (Path(asked).suffix in ('.tum', '.txt') or
                                     Path(asked).is_file())
    truth = read_tum(asked) if is_file else None
    bag = Bag(args.bag)
    named = TopicNames(args.image_topic, args.camera_info_topic, args.odom_topic,
                       None if is_file else asked, args.mask_topic)
    topics = choose_topics(bag, named, find_truth=not is_file,
                           find_mask=_base_parameters(args).mask.from_topic)
    notes = list(topics.notes)
    if topics.truth is not None:
        truth, truth_notes = read_truth(bag, topics, _base_parameters(args).frames.map)
        notes += truth_notes
    return bag, topics, truth, notes


def _base_parameters(args: argparse.Namespace) -> Parameters:
    from gip_localizer.cli.settings import recorded_parameters

    masked = {} if args.mask_topic is None else {'mask.from_topic': True}
    return recorded_parameters(args, masked)


def _start(
    args: argparse.Namespace, bag: Bag, topics: Topics, truth: Trajectory | None
) -> Pose2 | None:
    """Return the pose of --initial-pose; None if it is not given."""
    from gip_localizer.errors import ParameterError
    from gip_localizer.io.bags.truth import truth_at_first_image
    from gip_localizer.io.bags.window import BagWindow

    if args.initial_pose is None:
        return None
    if args.initial_pose != 'truth':
        return _pose_of(args.initial_pose)
    if truth is None:
        raise ParameterError('--initial-pose truth: there is no ground truth to start from')
    return truth_at_first_image(bag, topics, truth, BagWindow(args.start, args.duration))


def _parameters(args: argparse.Namespace, start: Pose2 | None) -> Parameters:
    from gip_localizer.cli.settings import file_next_to
    from gip_localizer.errors import ParameterError

    changes: dict[str, object] = {}
    if args.metric:
        changes['score.metric'] = args.metric
    if start is not None:
        changes |= {'initial_pose.set': True, 'initial_pose.x': start.x,
                    'initial_pose.y': start.y, 'initial_pose.yaw': start.yaw}
    parameters = _base_parameters(args).replace(changes)
    raster = args.map or parameters.map_file or file_next_to(args.bag, 'map.yaml')
    if not raster:
        raise ParameterError('no map: give --map MAP.yaml, or map_file in --params')
    return parameters.replace({'map_file': str(raster)})


def _pose_of(text: str) -> Pose2:
    from gip_localizer.core.pose import Pose2
    from gip_localizer.errors import ParameterError

    try:
        x, y, yaw = (float(word) for word in text.split(','))
    except ValueError:
        raise ParameterError(
            f'--initial-pose {text}: expected X,Y,YAW in metres and radians, e.g. 1.5,-2,0.1'
        ) from None
    return Pose2(x, y, yaw)


def _sources(args: argparse.Namespace, topics: Topics) -> dict[str, Any]:
    names = {
        'image': topics.image, 'camera_info': topics.camera_info, 'odometry': topics.odometry,
        'truth': topics.truth, 'mask': topics.mask,
    }
    sources: dict[str, Any] = {'bag': ', '.join(str(path) for path in args.bag)}
    if args.params is not None:
        sources['params'] = str(args.params)
    sources |= {key: topic.name for key, topic in names.items() if topic is not None}
    if topics.truth is None and args.ground_truth:
        sources['truth'] = args.ground_truth
    return sources


def _with_progress(replay: Replay, window: Any, total: int) -> None:
    from tqdm import tqdm

    with tqdm(total=total or None, unit='frame', disable=None, file=sys.stderr) as bar:
        fixes = 0

        def show(estimate: Estimate) -> None:
            nonlocal fixes
            fixes += estimate.published
            bar.set_postfix_str(f'{fixes} fixes, {estimate.status}', refresh=False)
            bar.update()

        replay.run(window, show)
