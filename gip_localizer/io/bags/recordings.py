# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Grouping of several bags into recordings.

Parts of one recording (a split bag, or images and odometry recorded into different files) must be
read as one stream; separate drives must not, for their stamps may overlap.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import CAMERA_INFO, IMAGES

MOST_APART_NS = 1_000_000_000
"""Longest time between the end of one part of a recording and the beginning of the next, ns: the
recorder opens the next file at once, and a camera delivers several images in it; chosen."""


@dataclass(frozen=True)
class _Recording:
    path: Path
    images: frozenset[str]
    calibrated: bool
    start_ns: int
    end_ns: int

    @classmethod
    def of(cls, path: Path, image_topic: str | None) -> _Recording:
        bag = Bag([path])
        names = {topic.name for topic in bag.topics if topic.msgtype in IMAGES and topic.messages}
        if image_topic is not None:
            names = {name for name in names if name.lstrip('/') == image_topic.lstrip('/')}
        calibrated = any(topic.msgtype in CAMERA_INFO for topic in bag.topics)
        return cls(path, frozenset(names), calibrated, bag.start_ns, bag.end_ns)

    def follows(self, other: _Recording) -> bool:
        """Whether this part continues the other, or completes it with other topics."""
        if self.images == other.images:
            apart = abs(self.start_ns - other.end_ns)
            return self.start_ns > other.start_ns and apart <= MOST_APART_NS
        complete = self.calibrated and other.calibrated
        return not complete and not self.images & other.images and self.overlaps(other)

    def overlaps(self, other: _Recording) -> bool:
        """Whether the times of both recordings overlap."""
        return self.start_ns <= other.end_ns and other.start_ns <= self.end_ns


def recordings(paths: Sequence[Path], image_topic: str | None = None) -> list[list[Path]]:
    """
    Group bags into recordings.

    Parameters
    ----------
    paths : sequence of Path
        Folders or files, in any order.
    image_topic : str or None
        The topic of the images, where the user named one: others do not count.

    Returns
    -------
    list of list of Path
        Bags of each recording in order of time. A bag that continues another within a second, with
        the same image topics, or that holds other image topics of the same time where not both
        hold a calibration, belongs to the other's recording. A bag without images belongs to all
        recordings of its time, or to every one if it shares the time of none.

    Raises
    ------
    BagError
        A bag cannot be opened.

    """
    if len(paths) == 1:
        return [list(paths)]
    parts = sorted((_Recording.of(path, image_topic) for path in paths),
                   key=lambda part: part.start_ns)
    groups: list[list[_Recording]] = []
    for part in (part for part in parts if part.images):
        group = next((g for g in groups if any(part.follows(other) for other in g)), None)
        if group is None:
            groups.append([part])
        else:
            group.append(part)
    if not groups:
        return [list(paths)]
    for part in (part for part in parts if not part.images):
        same_time = [g for g in groups if any(part.overlaps(other) for other in g)]
        for group in same_time or groups:
            group.append(part)
    return [[part.path for part in group] for group in groups]
