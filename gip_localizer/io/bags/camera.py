# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a bag, mounted as the parameters say."""

from __future__ import annotations

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import BagError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics
from gip_localizer.io.messages import calibration
from gip_localizer.parameters import Parameters


def recorded_camera(bag: Bag, topics: Topics, parameters: Parameters) -> CameraModel:
    """
    Return the camera of the first camera_info that can be read.

    Raises
    ------
    BagError
        None can be read.
    CalibrationError
        It cannot be used.

    """
    return CameraModel.given(_calibration(bag, topics), parameters.camera)


def _calibration(bag: Bag, topics: Topics) -> Calibration:
    for message in bag.messages([topics.camera_info.name]):
        decoded = bag.decode(message)
        if decoded is not None:
            return calibration(decoded)
    raise BagError(f'no camera_info of {topics.camera_info.name} can be read')
