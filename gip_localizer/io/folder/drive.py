# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A folder of images as a drive, and the bag with its parameter file that is made of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from gip_localizer.core.arrays import Floats
from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import CalibrationError
from gip_localizer.io.bags.sensor_messages import (
    image_message,
    IMAGE_TYPE,
    info_message,
    INFO_TYPE,
    mounting_message,
    OPTICAL,
    TF_TYPE,
)
from gip_localizer.io.bags.writer import BagWriter, make, make_header
from gip_localizer.io.camera_info_files import CameraInfo
from gip_localizer.io.folder.images import ImageFolder
from gip_localizer.io.folder.poses import SpatialPoses, start_pose
from gip_localizer.io.messages import calibration
from gip_localizer.parameters import dump_parameter_file, Parameters

NAME = 'drive'
IMAGE, INFO, TRUTH, TF = '/image', '/camera_info', '/ground_truth', '/tf_static'
TYPES = {IMAGE: IMAGE_TYPE, INFO: INFO_TYPE, TRUTH: 'geometry_msgs/msg/PoseStamped', TF: TF_TYPE}
STAMPED_FROM_NS = 1_000_000_000
"""Stamp (ns) that images whose stamps begin at 0 or before get first: 0 means "not stamped"."""


@dataclass(frozen=True)
class FolderDrive:
    """
    A drive, ready to be written.

    Attributes
    ----------
    images : ImageFolder
        The images with their stamps.
    info : CameraInfo
        The calibration.
    parameters : Parameters
        Of the localizer: the mounting of the camera and whatever was set.
    poses : SpatialPoses or None
        Poses of base_link in the map frame.

    """

    images: ImageFolder
    info: CameraInfo
    parameters: Parameters
    poses: SpatialPoses | None

    @property
    def shift_ns(self) -> int:
        """Nanoseconds that are added to all stamps."""
        first = self.images.images[0][0]
        return STAMPED_FROM_NS - first if first <= 0 else 0

    @property
    def notes(self) -> list[str]:
        """What was assumed, one line each."""
        notes = [*self.images.notes, *(self.poses.notes if self.poses is not None else ())]
        if self.shift_ns:
            notes.append('the stamps begin at 0, which means "not stamped" in ROS: '
                         f'{self.shift_ns * 1e-9:g} s are added to all')
        if self.poses is None:
            notes.append('there are no poses: the drive can be localized, but not judged, and no '
                         'map can be made of it; name a file with --poses')
        return notes

    def write(self, folder: Path, on_frame: Callable[[], object]) -> None:
        """
        Write the bag and params.yaml into an existing empty folder.

        Parameters
        ----------
        folder : Path
            Afterwards a rosbag2 folder that also holds params.yaml.
        on_frame : callable
            Called after each image.

        Raises
        ------
        GipError
            An image cannot be read, has another size than the first or than the calibration.

        """
        numbers = calibration(self.info)
        camera = CameraModel.given(numbers, self.parameters.camera)
        with BagWriter(folder / NAME, self._types(), compress=True,
                       latched=frozenset({TF})) as bag:
            first = self._shifted(self.images.images[0][0])
            bag.write(TF, first, mounting_message(
                first, self.parameters.frames.base, camera.extrinsics))
            poses = iter(self._poses())
            pose = next(poses, None)
            for stamp, grey in self.images.pictures():
                _check_size(grey.shape[::-1], camera)
                while pose is not None and pose[0] <= stamp:
                    self._write_pose(bag, *pose)
                    pose = next(poses, None)
                self._write_image(bag, self._shifted(stamp), grey, numbers)
                on_frame()
            for rest in ([] if pose is None else [pose, *poses]):
                self._write_pose(bag, *rest)
        for file in sorted((folder / NAME).iterdir()):
            file.rename(folder / file.name)
        (folder / NAME).rmdir()
        text = dump_parameter_file(self._started())
        (folder / 'params.yaml').write_text(text, encoding='utf-8')

    def _types(self) -> dict[str, str]:
        return {topic: kind for topic, kind in TYPES.items()
                if topic != TRUTH or self.poses is not None}

    def _shifted(self, stamp: int) -> int:
        return stamp + self.shift_ns

    def _poses(self) -> list[tuple[int, Floats]]:
        """Return stamp and pose of what is not before the first stamp that a bag can hold."""
        if self.poses is None:
            return []
        pairs = zip(self.poses.stamps_ns, self.poses.T_map_base, strict=True)
        return [(int(stamp), T) for stamp, T in pairs if self._shifted(int(stamp)) >= 0]

    def _write_image(self, bag: BagWriter, stamp: int, grey: Any, numbers: Calibration) -> None:
        header = make_header(stamp, OPTICAL)
        bag.write(INFO, stamp, info_message(header, numbers))
        bag.write(IMAGE, stamp, image_message(header, grey))

    def _write_pose(self, bag: BagWriter, stamp: int, T_map_base: Floats) -> None:
        header = make_header(self._shifted(stamp), self.parameters.frames.map)
        bag.write(TRUTH, self._shifted(stamp), make(
            TYPES[TRUTH], header=header, pose=_pose(T_map_base)))

    def _started(self) -> Parameters:
        """Return the parameters with the pose at the first image as the initial pose."""
        stamps = [stamp for stamp, _ in self.images.images]
        start = None if self.poses is None else start_pose(self.poses, stamps)
        if start is None:
            return self.parameters
        return self.parameters.replace({
            'initial_pose.set': True, 'initial_pose.x': start.x, 'initial_pose.y': start.y,
            'initial_pose.yaw': start.yaw,
        })


def _pose(T: Floats) -> Any:
    x, y, z, w = (float(value) for value in Rotation.from_matrix(T[:3, :3]).as_quat())
    position = (float(value) for value in np.asarray(T[:3, 3]))
    return make(
        'geometry_msgs/msg/Pose',
        position=make('geometry_msgs/msg/Point', **dict(zip('xyz', position, strict=True))),
        orientation=make('geometry_msgs/msg/Quaternion', x=x, y=y, z=z, w=w),
    )


def _check_size(size: tuple[int, ...], camera: CameraModel) -> None:
    if size != (camera.width, camera.height):
        raise CalibrationError(
            f'the images are {size[0]}x{size[1]}, the calibration is for '
            f'{camera.width}x{camera.height}; give the calibration of this camera and mode'
        )
