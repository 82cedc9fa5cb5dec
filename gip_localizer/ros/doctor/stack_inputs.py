# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of the inputs of the localizer: images, calibration, odometry."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.birdseye.view_choice import complete_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.errors import CalibrationError, ImageError
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.io.messages import calibration, calibration_note, other_frame
from gip_localizer.parameters import Birdseye, Parameters
from gip_localizer.ros.doctor.check import Check
from gip_localizer.ros.doctor.observed import Heard, Observed

MOST_LOST = 0.1
"""Share of the frames whose loss is reported; chosen."""
ROAD_POINTS = 9
"""Points along each side of the patch of road that are looked for in the image; chosen."""


def image(seen: Observed) -> Check:
    """Check that usable images come, in time and without gaps."""
    heard, name = seen.topics['image'], 'image'
    if fault := unheard(name, heard, seen.seconds):
        return fault
    found = f'{heard.topic}: {_rate(heard)}'
    try:
        compressed = seen.parameters.image_transport != 'raw'
        grey = (compressed_grey_image if compressed else grey_image)(heard.last)
    except ImageError as error:
        return Check(name, f'{found}: {error}', 'correct the driver, or set image_transport')
    found += f', {grey.shape[1]} x {grey.shape[0]}'
    if 0 in heard.stamps_ns:
        return Check(name, f'{found}, header.stamp is 0',
                     'the driver must set the stamp to the time of exposure')
    if len(set(heard.stamps_ns)) < len(heard.stamps_ns) or heard.stamps_ns != sorted(
        heard.stamps_ns
    ):
        return Check(name, f'{found}, stamps repeat or go back',
                     'two cameras publish the same topic, or the driver repeats frames')
    return _lost(name, found, heard)


def _lost(name: str, found: str, heard: Heard) -> Check:
    """Compare the number of frames with the time between their stamps."""
    period = heard.period()
    if not period:
        return Check(name, found)
    expected = 1 + round((heard.stamps_ns[-1] - heard.stamps_ns[0]) * 1e-9 / period)
    lost = 1.0 - len(heard.stamps_ns) / expected
    if lost <= MOST_LOST:
        return Check(name, found)
    return Check(name, f'{found}, {100 * lost:.0f} % of the frames are lost', (
        'start the camera with FASTRTPS_DEFAULT_PROFILES_FILE set to config/fastdds.xml, or '
        'publish it reliable and set image_reliability: reliable'
    ))  # fmt: skip


def camera_info(seen: Observed) -> Check:
    """Check that the calibration is usable, of the image's size, and sees the road."""
    heard, images, name = seen.topics['camera_info'], seen.topics['image'], 'camera_info'
    if fault := unheard(name, heard, seen.seconds):
        return fault
    try:
        camera = CameraModel.given(calibration(heard.last), seen.parameters.camera)
        if images.last is not None and seen.parameters.image_transport == 'raw':
            camera.for_image(grey_image(images.last))
    except (CalibrationError, ImageError, ValueError) as error:
        return Check(name, f'{heard.topic}: {error}', 'calibrate the camera at the size of its '
                     'images, and let the driver publish that')
    info = heard.last
    found = f'{heard.topic}: {info.width} x {info.height}, {info.distortion_model}'
    if note := calibration_note(heard.last):
        return Check(name, f'{heard.topic}: {note}', 'publish the name of the distortion model')
    if not seen.parameters.camera.from_tf and not _sees_road(camera, seen.parameters):
        return Check(name, f'{found}: no road of birdseye.near to birdseye.far is in view',
                     'correct camera.z, camera.pitch, birdseye.near and birdseye.far')
    return Check(name, found)


def view_in_use(seen: Observed, map_resolution: float) -> Birdseye:
    """
    Return the view of the localizer, with the values that are chosen from the camera.

    Raises
    ------
    CalibrationError, ValueError
        A value is automatic, and the camera cannot be used or is not known.

    """
    given, message = seen.parameters.birdseye, seen.topics['camera_info'].last
    if not given.automatic:
        return given
    if message is None:
        raise CalibrationError('birdseye.* is automatic, and no camera_info was received')
    camera = CameraModel.given(calibration(message), seen.parameters.camera)
    return complete_view(given, camera, map_resolution)


def _sees_road(camera: CameraModel, parameters: Parameters) -> bool:
    try:
        view = complete_view(parameters.birdseye, camera)
    except CalibrationError:
        return False
    ahead, left = np.meshgrid(np.linspace(view.near, view.far, ROAD_POINTS),
                              np.linspace(-view.half_width, view.half_width, ROAD_POINTS))
    road = np.stack([ahead.ravel(), left.ravel(), np.zeros(ahead.size)], axis=1)
    pixels, valid = camera.project(road)
    width, height = camera.calibration.image_size
    inside = (pixels >= 0.0).all(axis=1) & (pixels < (width, height)).all(axis=1)
    return bool((inside & valid).any())


def odometry(seen: Observed) -> Check:
    """Check that odometry, if there is any, is of the right frames and of the images' time."""
    heard, images, name = seen.topics['odom'], seen.topics['image'], 'odom'
    frames = seen.parameters.frames
    if not heard.publishers and not heard.others:
        return Check(name, f'{heard.topic}: nothing publishes it; the velocity of the last poses '
                     'is used')
    if fault := unheard(name, heard, seen.seconds):
        return fault
    found = f'{heard.topic}: {_rate(heard)}'
    wrong = other_frame('of', heard.last.child_frame_id, 'frames.base', frames.base) or (
        other_frame('in', heard.last.header.frame_id, 'frames.odom', frames.odom)
    )
    if wrong:
        return Check(name, f'{found}: {wrong}', 'set frames.odom and frames.base, or remap odom')
    gap = seen.parameters.motion.max_gap
    if images.stamps_ns and (apart := _apart(images.stamps_ns, heard.stamps_ns)) > gap:
        return Check(name, f'{found}: its stamps are {apart:.3g} s from those of the images',
                     'both must be stamped by the same clock: synchronize the computers')
    return Check(name, found)


def _apart(images_ns: list[int], odometry_ns: list[int]) -> float:
    """Return the time from the last image to the nearest odometry, seconds."""
    return float(np.min(np.abs(np.subtract(odometry_ns, images_ns[-1])))) * 1e-9


def unheard(name: str, heard: Heard, seconds: float) -> Check | None:
    """Return the failed check of a topic without messages; None if there were any."""
    if not heard.publishers:
        others = ', '.join(heard.others[:3])
        remedy = f'remap: -r {name}:={heard.others[0]}' if heard.others else (
            'start its publisher; is ROS_DOMAIN_ID the same there?'
        )
        return Check(name, f'nothing publishes {heard.topic}' + (
            f'; of its type there is {others}' if others else ''
        ), remedy)  # fmt: skip
    if heard.conflict:
        return Check(name, heard.conflict, (
            f'set qos_overrides.{heard.topic}.subscription.reliability to best_effort (and '
            'durability to volatile)' if name != 'image' else
            'set image_reliability: best_effort'
        ))  # fmt: skip
    if heard.last is None:
        return Check(name, f'{heard.topic}: {heard.publishers} publisher(s), no message in '
                     f'{seconds:g} s', 'see whether the driver runs: ros2 topic hz '
                     f'{heard.topic}')
    return None


def _rate(heard: Heard) -> str:
    period = heard.period()
    return f'{1.0 / period:.1f} Hz' if period else f'{len(heard.stamps_ns)} message(s)'
