# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Known poses of base_link for verbs that need them: of the bag, or of a TUM file."""

from __future__ import annotations

import argparse
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.topics import Topics
    from gip_localizer.io.trajectory import Trajectory
    from gip_localizer.parameters import Parameters


def add_pose_options(parser: argparse.ArgumentParser) -> Any:
    """Add `--truth` and `--poses`; return their group."""
    poses = parser.add_argument_group('poses of base_link in the map frame')
    one = poses.add_mutually_exclusive_group()
    one.add_argument('--truth', '--ground-truth', metavar='TOPIC',
                     help='topic of the bag (default: found by name, as /ground_truth)')
    one.add_argument('--poses', type=user_path, metavar='FILE', help='TUM file')
    return poses


def known_poses(
    args: argparse.Namespace, bag: Bag, parameters: Parameters, purpose: str
) -> tuple[Topics, Trajectory, list[str]]:
    """Return topics, poses and notes for the user (raises TrajectoryError without poses)."""
    from gip_localizer.errors import TrajectoryError
    from gip_localizer.io.bags.topics import choose_topics, TopicNames, TRUTH
    from gip_localizer.io.bags.truth import read_truth
    from gip_localizer.io.tum_files import read_tum

    poses = None if args.poses is None else read_tum(args.poses)
    named = TopicNames(args.image_topic, args.camera_info_topic, truth=args.truth)
    topics = choose_topics(bag, named, find_truth=poses is None)
    notes = list(topics.notes)
    if poses is None:
        poses, truth_notes = read_truth(bag, topics, parameters.frames.map)
        notes += truth_notes
    if poses is None:
        raise TrajectoryError(
            f'the bag holds no poses to {purpose} with; give a TUM file with --poses, or a topic '
            f'with --truth (types: {", ".join(TRUTH)})' + ''.join(f'\n  {n}' for n in notes)
        )
    return topics, poses, notes
