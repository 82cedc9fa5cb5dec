# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Messages from their serialized bytes.

rclpy copies the pixels of an image three times on its way to Python (1 ms for 0.9 MB); here they
stay where the middleware has put them.

"""

from __future__ import annotations

from functools import lru_cache
from typing import Any

from rosbags.serde import SerdeError
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

from gip_localizer.errors import ImageError
from gip_localizer.io.foxglove_video import DEFINITION, VIDEO


@lru_cache(maxsize=1)
def jazzy() -> Typestore:
    """Return the message types of ROS 2 Jazzy, and Foxglove's video (shared; do not register)."""
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(DEFINITION, VIDEO))
    return store


def image_of(serialized: bytes, kind: str) -> Any:
    """
    Return an image message.

    Parameters
    ----------
    serialized : bytes
        CDR, with its encapsulation.
    kind : str
        Image or CompressedImage.

    Raises
    ------
    ImageError
        The bytes are no such message.

    """
    try:
        return jazzy().deserialize_cdr(serialized, f'sensor_msgs/msg/{kind}')
    except (SerdeError, AssertionError, IndexError) as error:
        raise ImageError(
            f'{len(serialized)} bytes are no sensor_msgs/msg/{kind}: {error}'
        ) from error
