# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What `gip replay` reads: one recording, its topics, ground truth, parameters and start."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from gip_localizer.cli.settings import file_next_to, recorded_parameters, unused_at_the_desk
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import ParameterError
from gip_localizer.evaluation.start_pose import start_note
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.camera import mounted
from gip_localizer.io.bags.topics import choose_topics, TopicNames, Topics
from gip_localizer.io.bags.truth import read_truth, truth_at_first_image
from gip_localizer.io.bags.window import BagWindow
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import read_tum
from gip_localizer.parameters import Parameters


@dataclass(frozen=True)
class ReplayInput:
    """
    The input of one run.

    Attributes
    ----------
    bag : Bag
        The recording.
    topics : Topics
        Topics to read.
    truth : Trajectory or None
        Ground truth, of the bag or of a file.
    window : BagWindow
        Part of the bag.
    parameters : Parameters
        As used.
    sources : dict
        Origin of everything, for `metrics.json` and the report.
    notes : list of str
        Notes for the user.

    """

    bag: Bag
    topics: Topics
    truth: Trajectory | None
    window: BagWindow
    parameters: Parameters
    sources: dict[str, Any]
    notes: list[str]


def check_options(args: argparse.Namespace) -> None:
    """Refuse options that contradict each other (raises ParameterError)."""
    if args.relocalize and args.initial_pose is not None:
        raise ParameterError('--relocalize searches the map without a start; leave out '
                             '--initial-pose')
    if args.no_odometry and args.odom_topic is not None:
        raise ParameterError('--no-odometry uses none; leave out --odom-topic')


def open_input(args: argparse.Namespace, paths: Sequence[Path]) -> ReplayInput:
    """
    Open a recording as the options say.

    Parameters
    ----------
    args : argparse.Namespace
        Options of `gip replay`.
    paths : sequence of Path
        Bags of the recording.

    Raises
    ------
    GipError
        A bag, topic, file or option cannot be used.

    """
    file = args.params or file_next_to(paths, 'params.yaml')
    base = _base_parameters(args, paths)
    window, bag = BagWindow(args.start, args.duration), Bag(paths)
    asked = args.ground_truth
    is_file = asked is not None and (Path(asked).suffix in ('.tum', '.txt') or
                                     Path(asked).is_file())
    truth = read_tum(asked) if is_file else None
    named = TopicNames(args.image_topic, args.camera_info_topic, args.odom_topic,
                       None if is_file else asked, args.mask_topic)
    topics = choose_topics(bag, named, find_truth=not is_file, find_mask=base.mask.from_topic)
    notes = list(topics.notes)
    if topics.truth is not None:
        truth, truth_notes = read_truth(bag, topics, base.frames.map)
        notes += truth_notes
    topics = _left_out(args, topics)
    start = _start(args, bag, topics, truth)
    parameters, said = mounted(bag, topics, _parameters(args, paths, base, start))
    warning = start_note(parameters.initial_pose, bag, topics, truth, window)
    notes += [*said, *unused_at_the_desk(parameters), *([warning] if warning else [])]
    sources = _sources(args, paths, topics, file)
    return ReplayInput(bag, topics, truth, window, parameters, sources, notes)


def _base_parameters(args: argparse.Namespace, paths: Sequence[Path]) -> Parameters:
    masked = {} if args.mask_topic is None else {'mask.from_topic': True}
    return recorded_parameters(argparse.Namespace(**{**vars(args), 'bag': paths}), masked)


def _left_out(args: argparse.Namespace, topics: Topics) -> Topics:
    """Return the topics without what the options leave out."""
    if args.no_odometry:
        topics = replace(topics, odometry=None)
    return replace(topics, initial_pose=None) if args.relocalize else topics


def _parameters(args: argparse.Namespace, paths: Sequence[Path], base: Parameters,
                start: Pose2 | None) -> Parameters:
    changes: dict[str, object] = {}
    if args.metric:
        changes['score.metric'] = args.metric
    if args.relocalize:
        changes['initial_pose.set'] = False
    if start is not None:
        changes |= {'initial_pose.set': True, 'initial_pose.x': start.x,
                    'initial_pose.y': start.y, 'initial_pose.yaw': start.yaw}
    parameters = base.replace(changes)
    raster = args.map or parameters.map_file or file_next_to(paths, 'map.yaml')
    if not raster:
        raise ParameterError('no map: give --map MAP.yaml, or map_file in --params')
    return parameters.replace({'map_file': str(raster)})


def _start(
    args: argparse.Namespace, bag: Bag, topics: Topics, truth: Trajectory | None
) -> Pose2 | None:
    """Return the pose of --initial-pose; None if it is not given."""
    if args.initial_pose is None:
        return None
    if args.initial_pose != 'truth':
        return _pose_of(args.initial_pose)
    if truth is None:
        raise ParameterError('--initial-pose truth: there is no ground truth to start from')
    return truth_at_first_image(bag, topics, truth, BagWindow(args.start, args.duration))


def _pose_of(text: str) -> Pose2:
    try:
        x, y, yaw = (float(word) for word in text.split(','))
    except ValueError:
        raise ParameterError(
            f'--initial-pose {text}: expected X,Y,YAW in metres and radians, e.g. 1.5,-2,0.1'
        ) from None
    return Pose2(x, y, yaw)


def _sources(args: argparse.Namespace, paths: Sequence[Path], topics: Topics,
             params: Path | None) -> dict[str, Any]:
    names = {
        'image': topics.image, 'camera_info': topics.camera_info, 'odometry': topics.odometry,
        'truth': topics.truth, 'mask': topics.mask,
    }
    sources: dict[str, Any] = {'bag': ', '.join(str(path) for path in paths)}
    if params is not None:
        sources['params'] = str(params)
    sources |= {key: topic.name for key, topic in names.items() if topic is not None}
    if topics.truth is None and args.ground_truth:
        sources['truth'] = args.ground_truth
    if args.no_odometry:
        sources['odometry'] = 'not used (--no-odometry)'
    if args.relocalize:
        sources['start'] = 'searched on the whole map (--relocalize)'
    return sources
