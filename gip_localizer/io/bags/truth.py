# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The ground truth that a bag holds."""

from __future__ import annotations

from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics, TRUTH
from gip_localizer.io.messages import planar_pose, PoseMessageError, stamp_ns
from gip_localizer.io.trajectory import roll_and_pitch, STEEPEST, Trajectory


def read_truth(bag: Bag, topics: Topics, map_frame: str) -> tuple[Trajectory | None, list[str]]:
    """
    Read the ground truth of a bag.

    Parameters
    ----------
    bag : Bag
        Where it is.
    topics : Topics
        Names its topic, or none.
    map_frame : str
        The frame that it should be in.

    Returns
    -------
    Trajectory or None
        None where there is none.
    list of str
        What is to be said of it.

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
