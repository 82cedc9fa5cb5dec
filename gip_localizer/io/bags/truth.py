# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth in a bag, and the initial pose of a replay."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.pose import Pose2
from gip_localizer.errors import TrajectoryError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics, TRUTH
from gip_localizer.io.bags.window import BagWindow
from gip_localizer.io.messages import planar_pose, PoseMessageError, stamp_ns
from gip_localizer.io.trajectory import MAX_GAP_NS, stamp_text, Trajectory
from gip_localizer.io.tum_files import roll_and_pitch, STEEPEST


def read_truth(bag: Bag, topics: Topics, map_frame: str) -> tuple[Trajectory | None, list[str]]:
    """
    Read the ground truth of a bag.

    Parameters
    ----------
    bag : Bag
        The bag.
    topics : Topics
        Contains the topic of the truth, or None.
    map_frame : str
        Expected frame of the truth.

    Returns
    -------
    Trajectory or None
        None if the bag has no truth.
    list of str
        Warnings about it.

    """
    if topics.truth is None:
        return None, []
    name = topics.truth.name
    samples, frames, refused, steep = [], set(), 0, 0
    for raw in bag.messages([name]):
        message = bag.decode(raw) if raw.msgtype in TRUTH else None
        if message is None:
            continue
        frames.add(message.header.frame_id)
        posed = message.pose if raw.msgtype == TRUTH[0] else message.pose.pose
        try:
            samples.append((stamp_ns(message.header), planar_pose(posed)))
            q = posed.orientation
            steep += max(map(abs, roll_and_pitch(q.x, q.y, q.z, q.w))) > STEEPEST
        except PoseMessageError:
            refused += 1
    notes = [f'ground truth {name} is in frame {frame!r}, not in {map_frame!r}: errors hold only '
             'if both are the same' for frame in sorted(frames - {map_frame, ''})]
    if steep:
        notes.append(f'ground truth {name}: {steep} of {len(samples)} poses roll or pitch beyond '
                     'any road; is it the pose of base_link, z up?')
    if refused:
        notes.append(f'ground truth {name}: {refused} messages hold no usable pose')
    return (Trajectory.from_samples(samples) if samples else None), notes


def truth_at_first_image(
    bag: Bag, topics: Topics, truth: Trajectory, window: BagWindow
) -> Pose2:
    """
    Return the true pose at the first image of the part of the bag that is replayed.

    Raises
    ------
    TrajectoryError
        The truth does not cover that image, or no image can be read.

    """
    messages = bag.messages([topics.image.name], *window.log_times(bag))
    stamp = next((stamp_ns(image.header) for image in map(bag.decode, messages)
                  if image is not None), None)
    if stamp is None:
        raise TrajectoryError(
            f'no image of {topics.image.name} can be read in the selected part of the bag; see '
            '--start and --duration'
        )
    x, y, yaw = (float(value) for value in truth.at(np.array([stamp]))[0])
    if np.isfinite([x, y, yaw]).all():
        return Pose2(x, y, yaw)
    raise TrajectoryError(_uncovered(stamp, truth, window))


def _uncovered(stamp: int, truth: Trajectory, window: BagWindow) -> str:
    first, last = int(truth.stamps_ns[0]), int(truth.stamps_ns[-1])
    remedy = 'give --initial-pose X,Y,YAW'
    if stamp < first:
        later = window.start_s + (first - stamp) * 1e-9
        remedy = f'begin later (--start {later:.3f}), or {remedy}'
    return (
        f'--initial-pose truth: the first image is of {stamp_text(stamp)} s, and the ground truth '
        f'covers {stamp_text(first)} to {stamp_text(last)} s (gaps above {MAX_GAP_NS * 1e-9:g} s '
        f'are not interpolated); {remedy}'
    )
