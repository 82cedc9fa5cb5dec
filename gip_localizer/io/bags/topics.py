# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Choice of the topics to read from a bag: by name, or by type if only one has it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
import re

from gip_localizer.errors import BagError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.source import Topic
from gip_localizer.io.foxglove_video import VIDEO

IMAGES = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', VIDEO)
MASK = IMAGES[:1]
"""Types of a mask: only uncompressed images."""
CAMERA_INFO = ('sensor_msgs/msg/CameraInfo',)
ODOMETRY = ('nav_msgs/msg/Odometry',)
INITIAL_POSE = ('geometry_msgs/msg/PoseWithCovarianceStamped',)
TRUTH = ('geometry_msgs/msg/PoseStamped', *INITIAL_POSE, *ODOMETRY)
TRUTH_NAME = re.compile(r'truth|(^|[/_])gt([/_]|$)|reference', re.IGNORECASE)
OWN_OUTPUTS = re.compile(r'(^|/)(pose|pose_with_covariance|initialpose|goal_pose)$')


@dataclass(frozen=True)
class TopicNames:
    """Names from the user; None: chosen by type."""

    image: str | None = None
    camera_info: str | None = None
    odometry: str | None = None
    truth: str | None = None
    mask: str | None = None


@dataclass(frozen=True)
class Topics:
    """
    The topics that a replay reads.

    Attributes
    ----------
    image, camera_info : Topic
        Of the camera.
    odometry, initial_pose, truth : Topic or None
        None: the bag has none.
    mask : Topic or None
        None: no mask is required.
    notes : tuple of str
        Choices that were made without a name.

    """

    image: Topic
    camera_info: Topic
    odometry: Topic | None
    initial_pose: Topic | None
    truth: Topic | None
    notes: tuple[str, ...] = ()
    mask: Topic | None = None

    @property
    def replayed(self) -> set[str]:
        """Names of the topics that go to the localizer."""
        topics = (self.image, self.camera_info, self.odometry, self.initial_pose, self.mask)
        return {topic.name for topic in topics if topic is not None}


def choose_topics(
    bag: Bag, named: TopicNames, *, find_truth: bool = True, find_mask: bool = False
) -> Topics:
    """
    Choose the topics before any message is decoded.

    Parameters
    ----------
    bag : Bag
        Its list of topics.
    named : TopicNames
        What the user named.
    find_truth : bool
        False: the truth comes from another source.
    find_mask : bool
        True: a mask is required, by name or as the only image topic named `mask`.

    Raises
    ------
    BagError
        A named topic is missing or has the wrong type, or the choice is not unique; the
        candidates are listed.

    """
    topics = [topic for topic in bag.topics if bag.known(topic) and topic.messages]
    mask = _mask(topics, named) if find_mask or named.mask is not None else None
    rest = [topic for topic in topics if mask is None or topic.name != mask.name]
    image = _one(rest, IMAGES, named.image, 'image', '--image-topic')
    if image is None:
        raise BagError(
            'the bag holds no sensor_msgs/msg/Image, CompressedImage or foxglove_msgs/msg/'
            'CompressedVideo; it holds: '
            + _listed(bag.topics)
        )
    sibling = _sibling_info(topics, image.name)
    info = _one(topics, CAMERA_INFO, named.camera_info or sibling, 'camera info',
                '--camera-info-topic')
    if info is None:
        raise BagError(
            'the bag holds no sensor_msgs/msg/CameraInfo; the camera\'s calibration is needed. '
            'It holds: ' + _listed(bag.topics)
        )
    truth, notes = (_truth(topics, named) if find_truth else (None, ()))
    rest = [topic for topic in topics if truth is None or topic.name != truth.name]
    odometry = _one([t for t in rest if not TRUTH_NAME.search(t.name) or t.name == named.odometry],
                    ODOMETRY, named.odometry, 'odometry', '--odom-topic')
    initial = [t for t in rest
               if t.msgtype in INITIAL_POSE and t.name.rsplit('/', 1)[-1] == 'initialpose']
    return Topics(image, info, odometry, initial[0] if initial else None, truth, notes,
                  mask)


def _one(topics: Collection[Topic], types: Collection[str], name: str | None, what: str,
         option: str) -> Topic | None:
    fitting = [topic for topic in topics if topic.msgtype in types]
    if name is not None:
        found = [topic for topic in fitting if topic.name.lstrip('/') == name.lstrip('/')]
        if not found:
            raise BagError(
                f'no {what} topic {name!r} of type {" or ".join(types)} in the bag ({option}); '
                f'candidates: {_listed(fitting)}'
            )
        return found[0]
    if len(fitting) > 1:
        raise BagError(f'several {what} topics; choose one with {option}: {_listed(fitting)}')
    return fitting[0] if fitting else None


def _mask(topics: Collection[Topic], named: TopicNames) -> Topic:
    called = [topic for topic in topics if topic.name.rsplit('/', 1)[-1] == 'mask']
    mask = _one(topics if named.mask else called, MASK, named.mask, 'mask', '--mask-topic')
    if mask is None:
        raise BagError(
            'mask.from_topic is set, and the bag holds no sensor_msgs/msg/Image called mask; '
            'name it with --mask-topic, or set mask.from_topic=false. It holds: '
            + _listed(topics)
        )
    return mask


def _sibling_info(topics: Collection[Topic], image: str) -> str | None:
    """Return the CameraInfo topic next to the image (convention of ROS), if there is one."""
    names = {topic.name for topic in topics if topic.msgtype in CAMERA_INFO}
    parts = image.split('/')
    for depth in range(len(parts) - 1, 0, -1):
        candidate = '/'.join([*parts[:depth], 'camera_info'])
        if candidate in names:
            return candidate
    return None


def _truth(topics: Collection[Topic], named: TopicNames) -> tuple[Topic | None, tuple[str, ...]]:
    if named.truth is not None:
        return _one(topics, TRUTH, named.truth, 'ground truth', '--ground-truth'), ()
    taken = {named.odometry}
    fitting = [topic for topic in topics if topic.msgtype in TRUTH and topic.name not in taken]
    by_name = [topic for topic in fitting if TRUTH_NAME.search(topic.name)]
    by_type = [topic for topic in fitting
               if topic.msgtype not in ODOMETRY and not OWN_OUTPUTS.search(topic.name)]
    chosen = by_name or by_type
    if len(chosen) == 1:
        return chosen[0], (() if by_name else (f'ground truth is taken from {chosen[0].name}',))
    if chosen:
        return None, (
            f'several topics may be the ground truth; choose one with --ground-truth: '
            f'{_listed(chosen)}',
        )
    return None, ()


def _listed(topics: Collection[Topic]) -> str:
    return ', '.join(
        f'{topic.name} ({topic.msgtype or "no type"}, {topic.messages}'
        + ('' if topic.encoding == 'cdr' else f', encoding {topic.encoding!r} is not read') + ')'
        for topic in topics
    ) or 'none'
