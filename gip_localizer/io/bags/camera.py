# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a bag; its pose comes from the parameters or from the bag's /tf_static."""

from __future__ import annotations

import contextlib

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import BagError, ParameterError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics
from gip_localizer.io.messages import calibration
from gip_localizer.io.static_transforms import StaticTransforms, TransformError
from gip_localizer.parameters import Parameters

TF_STATIC, TRANSFORMS = '/tf_static', 'tf2_msgs/msg/TFMessage'


def mounted(bag: Bag, topics: Topics, parameters: Parameters) -> tuple[Parameters, list[str]]:
    """
    Return the parameters with the camera pose of the bag, if `camera.from_tf` is set.

    Parameters
    ----------
    bag, topics : Bag, Topics
        Source of /tf_static and of the frame_id of the first image (or camera_info).
    parameters : Parameters
        Parameters of the run.

    Returns
    -------
    parameters : Parameters
        The same, or with the six numbers of `camera.*` replaced.
    notes : list of str
        Remarks for the user.

    Raises
    ------
    BagError
        The bag does not connect the frames.
    ParameterError
        The transform gives an impossible camera pose.

    """
    if not parameters.camera.from_tf:
        return parameters, []
    base, frame = parameters.frames.base, _frame(bag, topics)
    try:
        extrinsics = _static_transforms(bag).extrinsics(base, frame)
    except TransformError as error:
        raise BagError(
            f'camera.from_tf is true, and {TF_STATIC} of the bag does not hold the pose of the '
            f'camera: {error}; set camera.from_tf=false and camera.x, y, z, roll, pitch, yaw, or '
            'record that topic'
        ) from None
    try:
        parameters = parameters.replace({
            f'camera.{name}': getattr(extrinsics, name) for name in Extrinsics.__dataclass_fields__
        })
    except ParameterError as error:
        raise ParameterError(
            f'camera.from_tf is true, and {TF_STATIC} gives an impossible pose of {frame!r} '
            f'in {base!r}: {error}'
        ) from None
    return parameters, [
        f'camera.from_tf: {frame!r} in {base!r} is taken from {TF_STATIC}: '
        f'x {extrinsics.x:.3f}, y {extrinsics.y:.3f}, z {extrinsics.z:.3f} m, '
        f'roll {extrinsics.roll:.4f}, pitch {extrinsics.pitch:.4f}, yaw {extrinsics.yaw:.4f} rad'
    ]


def _frame(bag: Bag, topics: Topics) -> str:
    """Return the frame of the camera: of the first image that names one, or camera_info."""
    for topic in (topics.image.name, topics.camera_info.name):
        first = next(bag.messages([topic]), None)
        decoded = None if first is None else bag.decode(first)
        if decoded is not None and decoded.header.frame_id:
            return str(decoded.header.frame_id)
    raise BagError(
        'camera.from_tf is true, and neither the first image nor the first camera_info names its '
        'frame; set camera.from_tf=false and camera.x, y, z, roll, pitch, yaw'
    )


def _static_transforms(bag: Bag) -> StaticTransforms:
    tree = StaticTransforms()
    names = {topic.name for topic in bag.topics
             if topic.msgtype == TRANSFORMS and topic.name.rsplit('/', 1)[-1] == TF_STATIC[1:]}
    for message in bag.messages(names):
        decoded = bag.decode(message)
        if decoded is not None:
            with contextlib.suppress(TransformError):  # missing ones are reported later
                tree.take(decoded.transforms)
    return tree


def recorded_camera(bag: Bag, topics: Topics, parameters: Parameters) -> CameraModel:
    """
    Return the camera of the first camera_info that can be read.

    Raises
    ------
    BagError
        No camera_info can be read.
    CalibrationError
        The camera_info cannot be used.

    """
    return CameraModel.given(_calibration(bag, topics), parameters.camera)


def _calibration(bag: Bag, topics: Topics) -> Calibration:
    for message in bag.messages([topics.camera_info.name]):
        decoded = bag.decode(message)
        if decoded is not None:
            return calibration(decoded)
    raise BagError(f'no camera_info of {topics.camera_info.name} can be read')
