# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Judges a running stack: the node, its inputs, frames, clock, map and poses."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import CalibrationError, GipError
from gip_localizer.io.map_files import load_map
from gip_localizer.parameters import Birdseye
from gip_localizer.ros.doctor.check import Check
from gip_localizer.ros.doctor.observed import Observed
from gip_localizer.ros.doctor.stack_inputs import camera_info, image, odometry, view_in_use
from gip_localizer.session.diagnostic_rules import MAP
from gip_localizer.session.diagnostic_types import Severity

ACTIVE = 'active'
GRID = 21
"""Points along each side of the patch of road that are looked for on the map; chosen."""


def stack_checks(seen: Observed) -> Iterator[Check]:
    """Yield the checks, in the order of the data."""
    for check in (node, clock, image, camera_info, odometry, frames, transforms, road_map, poses):
        yield check(seen)


def node(seen: Observed) -> Check:
    """Check that a localizer runs and takes images."""
    if not seen.node:
        return Check('node', 'no localizer runs; the topics are judged by their default names',
                     'ros2 run gip_localizer localizer --ros-args --params-file FILE')
    if seen.state and seen.state != ACTIVE:
        return Check('node', f'{seen.node} is {seen.state}', (
            f'ros2 lifecycle set {seen.node} '
            f'{"configure, and then activate" if seen.state == "unconfigured" else "activate"}'
        ))  # fmt: skip
    return Check('node', seen.node)


def clock(seen: Observed) -> Check:
    """Check that stamps and the clock of the node agree."""
    name, heard = 'clock', seen.topics['image']
    if seen.sim_time and len(set(seen.clocks_ns)) < 2:
        return Check(name, 'use_sim_time is set, and /clock does not move',
                     'start the simulator or bag_player, or set use_sim_time: false')
    source = '/clock' if seen.sim_time else 'the system'
    if not heard.stamps_ns or 0 in heard.stamps_ns:
        return Check(name, f'{source}; no image to compare with')
    delay, limits = heard.delay(), seen.parameters.diagnostics
    found = f'{source}; images arrive {delay:.3f} s after their stamp'
    if -limits.max_ahead <= delay <= limits.max_delay:
        return Check(name, found)
    simulated = bool(seen.clocks_ns) and not seen.sim_time
    return Check(name, found, 'set use_sim_time: true, since /clock is published' if simulated else
                 'synchronize the clocks (chrony, PTP), or reduce the delay of the camera')


def frames(seen: Observed) -> Check:
    """Check that image and camera_info name the same frame."""
    images, infos = seen.topics['image'].frames, seen.topics['camera_info'].frames
    named = sorted(images | infos)
    found = f'camera {" and ".join(map(repr, named)) or "unknown"}'
    expected = seen.parameters.frames
    found += f'; {expected.map}, {expected.odom}, {expected.base}'
    if images and infos and images != infos:
        return Check('frames', f'{found}: images and camera_info differ',
                     'camera_info is of another camera: remap it, or correct the driver')
    return Check('frames', found)


def transforms(seen: Observed) -> Check:
    """Check TF where the parameters need it."""
    name, wanted = 'tf', seen.parameters.frames
    if not (seen.parameters.camera.from_tf or seen.parameters.tf.publish):
        return Check(name, 'not used (camera.from_tf and tf.publish are false)')
    if not seen.tf_known:
        return Check(name, 'tf2_msgs is not installed', 'apt install ros-jazzy-tf2-msgs, or set '
                     'camera.from_tf and tf.publish to false')
    children = {child for _, child in seen.transforms}
    cameras = seen.topics['image'].frames | seen.topics['camera_info'].frames
    if seen.parameters.camera.from_tf and not cameras & children:
        return Check(name, f'nothing publishes the transform to {" or ".join(sorted(cameras))}',
                     f'publish {wanted.base} to the camera on /tf_static (robot_state_publisher)')
    if seen.parameters.tf.publish and (wanted.map, wanted.odom) not in seen.transforms:
        return Check(name, f'no transform from {wanted.map} to {wanted.odom}',
                     'see the check of the poses; odometry is needed too')
    return Check(name, f'{len(seen.transforms)} transforms')


def road_map(seen: Observed) -> Check:
    """Check that the map can be read, and covers what the vehicle sees."""
    name, path = 'map', seen.parameters.map_file
    level, said = seen.statuses.get(MAP.name, (Severity.OK, ''))
    if level >= Severity.ERROR:
        return Check(name, f'{path}: {said}', 'correct the start (initialpose, or the service '
                     '~/relocalize), or the origin of the map')
    if seen.statuses:
        return Check(name, f'{path}: the view lies on it')
    try:
        raster_map = load_map(path) if path else None
    except GipError as error:
        return Check(name, str(error), 'set map_file to the YAML file of a map')
    if raster_map is None:
        return Check(name, 'map_file is empty', 'set map_file to the YAML file of a map')
    return _covered(seen, raster_map)


def _covered(seen: Observed, raster_map: RasterMap) -> Check:
    """Compare the view at the initial pose with the known cells."""
    start, least = seen.parameters.initial_pose, seen.parameters.score.min_overlap
    width, height = raster_map.size_m
    found = f'{seen.parameters.map_file}: {width:.0f} x {height:.0f} m'
    if not start.set:
        return Check('map', f'{found}; no initial_pose.* to compare with')
    try:
        view = view_in_use(seen, raster_map.resolution)
    except (CalibrationError, ValueError) as error:
        return Check('map', f'{found}; no view to compare with: {error}')
    share = _known_share(raster_map, view, Pose2(start.x, start.y, start.yaw))
    found += f', {100 * share:.0f} % of the view at initial_pose is known'
    if share >= least:
        return Check('map', found)
    return Check('map', found, f'at least {100 * least:.0f} % is needed: correct initial_pose.*, '
                 'or the origin of the map')


def _known_share(raster_map: RasterMap, view: Birdseye, pose: Pose2) -> float:
    ahead, left = np.meshgrid(np.linspace(view.near, view.far, GRID),
                              np.linspace(-view.half_width, view.half_width, GRID))
    points = pose.transform(np.stack([ahead.ravel(), left.ravel()], axis=1))
    inside = np.asarray(raster_map.contains(points))
    if raster_map.valid is not None:
        cells = np.round(raster_map.to_cell(points[inside])).astype(int)
        rows, cols = raster_map.grey.shape
        inside[inside] = raster_map.valid[
            np.clip(cells[:, 0], 0, rows - 1), np.clip(cells[:, 1], 0, cols - 1)
        ]
    return float(inside.mean())


def poses(seen: Observed) -> Check:
    """Check that poses go out."""
    name, heard = 'poses', seen.topics['pose']
    if not seen.node:
        return Check(name, 'no localizer runs')
    said = [f'{group}: {text}' for group, (level, text) in seen.statuses.items()
            if level != Severity.OK]
    count, images = len(heard.stamps_ns), len(seen.topics['image'].stamps_ns)
    found = '; '.join([f'{heard.topic}: {count} poses of {images} images', *said])
    if count:
        return Check(name, found)
    return Check(name, found, 'docs/diagnostics.md says what each message means; the checks above '
                 'name what is missing' if seen.statuses else
                 f'{seen.node} publishes no /diagnostics: is it remapped, or hung?')
