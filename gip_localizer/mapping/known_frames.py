# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of a bag with the known pose of the vehicle, spread over the drive."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.pose import Pose2
from gip_localizer.errors import ImageError, TrajectoryError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import IMAGES, Topics
from gip_localizer.io.bit_depth import BitDepth
from gip_localizer.io.image_stream import decoded_images
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.io.messages import stamp_ns
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.mapping.mount_calibration import KnownFrame


def known_frames(bag: Bag, topics: Topics, poses: Trajectory, count: int) -> list[KnownFrame]:
    """
    Return about `count` images with their poses.

    Raises
    ------
    TrajectoryError
        No image can be used: none decodes, or none has a pose.

    """
    decode = compressed_grey_image if topics.image.msgtype in IMAGES[1:] else grey_image
    every = max(topics.image.messages // max(count, 1), 1)
    depth, frames, why = BitDepth(), [], 'there is none'
    messages = decoded_images(map(bag.decode, bag.messages([topics.image.name])))
    for number, message in enumerate(messages):
        if number % every or message is None:
            continue
        pose = Pose2(*poses.at(np.array([stamp_ns(message.header)], np.int64))[0].tolist())
        if not pose.is_finite():
            why = f'the image at {stamp_ns(message.header) * 1e-9:.3f} s has no pose'
            continue
        try:
            frames.append(KnownFrame(depth.scaled(decode(message)), pose))
        except ImageError as error:
            why = str(error)
    if not frames:
        raise TrajectoryError(
            f'no image of {topics.image.name} can be used: {why}; expected images and poses with '
            'stamps of one clock'
        )
    return frames
