# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameter groups for the integration of the node into a vehicle's ROS stack."""

from __future__ import annotations

from dataclasses import dataclass

from gip_localizer.parameters.spec import parameter as p
from gip_localizer.parameters.spec import ParameterGroup


@dataclass(frozen=True)
class Frames:
    """Names of the coordinate frames (REP 105)."""

    map: str = p('map', 'Frame of the map and of the published poses.', read_only=True)
    odom: str = p('odom', 'Frame of the odometry.', read_only=True)
    base: str = p('base_link', 'Frame of the vehicle, on the road under it.', read_only=True)


@dataclass(frozen=True)
class InitialPose:
    """Initial pose if no `initialpose` message is used."""

    set: bool = p(False, 'Take the pose below as the first prior.', read_only=True)
    x: float = p(0.0, 'Position in the map frame.', unit='m', low=-1e7, high=1e7, read_only=True)
    y: float = p(0.0, 'Position in the map frame.', unit='m', low=-1e7, high=1e7, read_only=True)
    yaw: float = p(0.0, 'Heading in the map frame.', unit='rad', low=-7.0, high=7.0,
                   read_only=True)
    sigma_xy: float = p(0.3, 'Standard deviation of x and of y.', unit='m', low=1e-3, high=1e3,
                        read_only=True)
    sigma_yaw: float = p(0.03, 'Standard deviation of the heading.', unit='rad', low=1e-4,
                         high=3.2, read_only=True)


@dataclass(frozen=True)
class Attitude:
    """z, roll and pitch of the published poses, which are not estimated."""

    source: str = p('parameter', 'Source of z, roll and pitch: the parameters below, the last '
                    'initialpose message or the last odometry message.',
                    choices=('parameter', 'initialpose', 'odom'))
    z: float = p(0.0, 'Height of frames.base in the map frame.', unit='m', low=-1e4, high=1e4)
    roll: float = p(0.0, 'Roll of the road.', unit='rad', low=-0.8, high=0.8)
    pitch: float = p(0.0, 'Pitch of the road.', unit='rad', low=-0.8, high=0.8)
    sigma_z: float = p(1000.0, 'Standard deviation of z in pose_with_covariance; so large that '
                       'filters ignore z.', unit='m', low=1e-3, high=1e6)
    sigma_tilt: float = p(10.0, 'Standard deviation of roll and of pitch.', unit='rad', low=1e-4,
                          high=1e3)


@dataclass(frozen=True)
class Transforms:
    """Transforms on /tf; without the package tf2_msgs the node reports an error."""

    publish: bool = p(False, 'Publish map to odom on /tf (needs tf2_msgs and odometry); only one '
                      'node may publish it.', read_only=True)
    tolerance: float = p(0.5, 'Post-dating: time by which the stamp of the transform is ahead of '
                         'the image; at least period plus latency of the images.', unit='s',
                         low=0.0, high=10.0)
    hold: float = p(1.0, 'Time after a pose during which its transform is repeated at 10 Hz; 0: '
                    'sent once.', unit='s', low=0.0, high=60.0)


@dataclass(frozen=True)
class MaskTopic:
    """A mask for each image on the topic `mask`, for example from a segmentation network."""

    from_topic: bool = p(False, 'Use a mask for each image from the topic mask, in addition to '
                         'mask_file (mono8, size and stamp of the image; 128 and above is '
                         'used).',
                         read_only=True)
    tolerance: float = p(0.0, 'Largest difference between the stamps of an image and its mask.',
                         unit='s', low=0.0, high=1.0)
    timeout: float = p(0.1, 'Longest time that an image waits for its mask.', unit='s', low=0.0,
                       high=10.0)
    required: bool = p(False, 'Whether an image needs a usable mask. True: without one no pose is '
                       'published; false: it is localized without a mask.')


@dataclass(frozen=True)
class State:
    """The last pose, saved in `state_file` for a restart."""

    period: float = p(1.0, 'Least time between two writings of state_file.', unit='s', low=0.1,
                      high=3600.0)
    max_age: float = p(60.0, 'Largest age of a state_file that is used.', unit='s', low=0.1,
                       high=1e7, read_only=True)


@dataclass(frozen=True)
class Diagnostics:
    """Limits from which /diagnostics warns of missing, late or future messages."""

    camera_timeout: float = p(1.0, 'Longest time without an image before a report.', unit='s',
                              low=0.05, high=3600.0)
    odometry_timeout: float = p(1.0, 'Longest time without odometry before a report.', unit='s',
                                low=0.05, high=3600.0)
    max_delay: float = p(0.5, 'Largest delay of an image after its stamp before a report.',
                         unit='s', low=0.0, high=3600.0)
    max_ahead: float = p(0.1, 'Largest time of a stamp ahead of the clock before a report.',
                         unit='s', low=0.0, high=3600.0)


@dataclass(frozen=True)
class BagPlayerParameters(ParameterGroup):
    """Parameters of the node `bag_player`."""

    bag: str = p('', 'Bag: a rosbag2 folder, an .mcap or a .db3 file.', read_only=True)
    rate: float = p(1.0, 'Speed relative to the recording.', low=0.01, high=100.0)
    start: float = p(0.0, 'Where to begin, after the first message; set while the bag is played: '
                     'where to go on.', unit='s', low=0.0, high=1e7)
    loop: bool = p(False, 'Begin again at the end.')
    paused: bool = p(False, 'Wait for the service ~/pause before the first message.',
                     read_only=True)
    topics: str = p('', 'Names of the topics to play, with commas between; empty: all.',
                    read_only=True)
    wait_for: str = p('', 'Names of topics, with commas between, that must each have a subscriber '
                      'before the first message, which comes 5 s later, after a camera_info; '
                      'empty: play at once.', read_only=True)
