# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Write a synthetic drive as a bag with map and parameters; same settings, same bytes."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from gip_localizer.errors import ParameterError
from gip_localizer.io.bags.sensor_messages import (
    compressed_message,
    COMPRESSED_TYPE,
    image_message,
    IMAGE_TYPE,
    info_message,
    INFO_TYPE,
    mounting_message,
    OPTICAL,
    TF_TYPE,
)
from gip_localizer.io.bags.writer import BagWriter, make, make_header, make_pose
from gip_localizer.io.map_files import save_map
from gip_localizer.io.messages import full_covariance
from gip_localizer.parameters import dump_parameter_file
from gip_localizer.parameters.ros_yaml import dump_ros_yaml
from gip_localizer.synthetic.drive import SyntheticDrive, SyntheticFrame
from gip_localizer.synthetic.localizer_parameters import localizer_parameters
from gip_localizer.synthetic.wheel_odometry import OdometryReading

NAME = 'drive'
START_NS = 1_700_000_000_000_000_000
"""Stamp of the first frame, nanoseconds since 1970: a date in November 2023; chosen."""
TRANSPORTS = ('raw', 'jpeg', 'png')
IMAGE, COMPRESSED = '/image', '/image/compressed'
INFO, ODOM, TRUTH, TF = '/camera_info', '/odom', '/ground_truth', '/tf_static'
TYPES = {
    IMAGE: IMAGE_TYPE, COMPRESSED: COMPRESSED_TYPE, INFO: INFO_TYPE,
    ODOM: 'nav_msgs/msg/Odometry', TRUTH: 'geometry_msgs/msg/PoseStamped', TF: TF_TYPE,
}


def write_drive(folder: Path, drive: SyntheticDrive, *, seconds: float, transport: str,
                quality: int, on_frame: Callable[[], object]) -> None:
    """
    Write bag, map and parameters into a folder.

    Parameters
    ----------
    folder : Path
        An existing empty folder. Afterwards it is a rosbag2 folder that also holds map.yaml,
        map.png, params.yaml (of the localizer) and synthetic_camera.yaml.
    drive : SyntheticDrive
        The drive to record.
    seconds : float
        Length of the recording.
    transport : str
        raw, jpeg or png.
    quality : int
        JPEG quality, 1 to 100.
    on_frame : callable
        Called after each image.

    Raises
    ------
    GipError
        The camera sees no road, or the transport cannot hold the bit depth of the images.

    """
    if transport == 'jpeg' and drive.parameters.sensor.bits != 8:
        raise ParameterError('jpeg holds 8 bits: choose --transport png, or sensor.bits=8')
    save_map(drive.raster_map, folder / 'map.yaml')
    settings = localizer_parameters(drive, compressed=transport != 'raw')
    (folder / 'params.yaml').write_text(dump_parameter_file(settings), encoding='utf-8')
    (folder / 'synthetic_camera.yaml').write_text(
        dump_ros_yaml(drive.parameters.to_dict()), encoding='utf-8'
    )
    bag_folder = folder / NAME
    left_out = COMPRESSED if transport == 'raw' else IMAGE
    topics = {topic: kind for topic, kind in TYPES.items() if topic != left_out}
    with BagWriter(bag_folder, topics, compress=True, latched=frozenset({TF})) as bag:
        bag.write(TF, drive.start_ns, mounting_message(
            drive.start_ns, drive.parameters.frames.base, drive.camera.extrinsics
        ))
        for event in drive.events(seconds):
            if isinstance(event, OdometryReading):
                _write_odometry(bag, event, drive)
            else:
                _write_frame(bag, event, drive, (transport, quality))
                on_frame()
    for file in sorted(bag_folder.iterdir()):
        file.rename(folder / file.name)
    bag_folder.rmdir()


def _write_odometry(bag: BagWriter, reading: OdometryReading, drive: SyntheticDrive) -> None:
    sample, frames = reading.sample, drive.parameters.frames
    twist = make(
        'geometry_msgs/msg/Twist',
        linear=make('geometry_msgs/msg/Vector3', x=sample.forward, y=sample.left, z=0.0),
        angular=make('geometry_msgs/msg/Vector3', x=0.0, y=0.0, z=sample.turn),
    )
    bag.write(ODOM, sample.stamp_ns, make(
        TYPES[ODOM], header=make_header(sample.stamp_ns, frames.odom), child_frame_id=frames.base,
        pose=make('geometry_msgs/msg/PoseWithCovariance', pose=make_pose(sample.pose),
                  covariance=full_covariance(reading.pose_covariance)),
        twist=make('geometry_msgs/msg/TwistWithCovariance', twist=twist,
                   covariance=full_covariance(reading.twist_covariance)),
    ))


def _write_frame(bag: BagWriter, frame: SyntheticFrame, drive: SyntheticDrive,
                 coding: tuple[str, int]) -> None:
    stamp = frame.stamp_ns
    header = make_header(stamp, OPTICAL)
    bag.write(INFO, stamp, info_message(header, frame.calibration))
    truth = make_header(stamp, drive.parameters.frames.map)
    bag.write(TRUTH, stamp, make(TYPES[TRUTH], header=truth, pose=make_pose(frame.truth)))
    if coding[0] == 'raw':
        bag.write(IMAGE, stamp, image_message(header, frame.image))
    else:
        bag.write(COMPRESSED, stamp, compressed_message(header, frame.image, *coding))
