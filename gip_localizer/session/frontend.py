# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Messages → localizer calls, in one place for the node and for bag replay.

A bad message raises nothing here: the fault is in the `Estimate` of the frame, or in `complaints`,
by topic, until the next good message of that topic.

"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import CalibrationError, GipError, ImageError
from gip_localizer.io import messages
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.parameters import Parameters
from gip_localizer.session.camera_input import CameraInput
from gip_localizer.session.image_input import ImageInput
from gip_localizer.session.initial_pose import prior_of
from gip_localizer.session.input_checks import LEAST_REPEATS, odometry_warnings, RepeatedImages
from gip_localizer.session.mask_sync import Masked
from gip_localizer.session.masks import MaskError
from gip_localizer.session.message_log import MessageLog
from gip_localizer.session.view_report import ViewReport


def _unheard(_line: str) -> None:
    """Take a line that nobody reads."""


UNSTAMPED = (
    'images are not stamped: header.stamp is 0; the camera driver must set it to the time of '
    'exposure'
)


class Frontend:
    """
    Decodes messages and passes them to a localizer.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    parameters : Parameters
        All tunables.

    Raises
    ------
    MapError
        `mask_file` is set and cannot be read.

    Attributes
    ----------
    localizer : Localizer
        The core.
    image : (height, width) array or None
        The last image; None if it could not be decoded.
    camera_frame : str
        frame_id of its header.
    view : ViewReport
        Description of the view in use.
    report : callable
        Takes a line about each accepted calibration and initial pose; the node logs it.
    warnings : dict
        Rule of `gip_localizer.session.diagnostic_rules` → detail, of the last frame.

    """

    def __init__(self, raster_map: RasterMap, parameters: Parameters) -> None:
        self.localizer = Localizer(raster_map, parameters)
        self.warnings: dict[str, str] = {}
        self.image: Grey | None = None
        self.camera_frame = ''
        self.view = ViewReport()
        self.report: Callable[[str], object] = _unheard
        self._repeats = RepeatedImages()
        self._log = MessageLog()
        self._camera = CameraInput()
        self._images = ImageInput(parameters.mask_file, self._log)

    @property
    def complaints(self) -> dict[str, str]:
        """Topic (camera_info, odom, initialpose) → fault of its last message."""
        return self._log.complaints

    @property
    def counts(self) -> dict[str, int]:
        """Number of messages per topic, and of refused ones (`<topic>_refused`)."""
        return self._log.counts

    def refuse(self, topic: str, reason: str) -> None:
        """Count a message as refused, and keep the reason."""
        self._log.refuse(topic, reason)

    @property
    def parameters(self) -> Parameters:
        """The parameters in force."""
        return self.localizer.parameters

    @property
    def camera(self) -> CameraModel | None:
        """The camera of the last frame; None before the first or if it cannot be used."""
        return self._camera.camera

    def configure(self, parameters: Parameters) -> None:
        """Use new parameters from the next frame on."""
        self.localizer.configure(parameters)
        self._camera.renew()

    def change_map(self, raster_map: RasterMap, parameters: Parameters) -> None:
        """Localize on another map; the tracking state is kept if `map_keeps_pose` is set."""
        if parameters.map_keeps_pose:
            self.localizer.change_map(raster_map)
            self.localizer.configure(parameters)
        else:
            self.localizer = Localizer(raster_map, parameters)
        self._camera.renew()

    @property
    def view_outdated(self) -> bool:
        """Whether the next frame waits until the view is computed for what changed."""
        if self._camera.camera is not None or self._camera.calibration is None:
            return False
        try:
            return not self.localizer.view_fits(self._calibrated_camera())
        except CalibrationError:
            return False

    def relocalize(self) -> None:
        """Search the whole map at the next frame."""
        self.localizer.relocalize()

    def on_camera_info(self, message: Any) -> None:
        """Use a sensor_msgs/CameraInfo; if it is unusable, the previous one is kept."""
        self._log.count('camera_info')
        try:
            changed = self._camera.take(message)
        except (CalibrationError, ValueError) as error:
            self.refuse('camera_info', str(error))
            return
        self._log.accept('camera_info')
        if changed:
            self.report(f'calibration taken: {messages.calibration_text(message)}')
            # Precompute before the first frame; that frame reports any error.
            with contextlib.suppress(CalibrationError):
                self.localizer.prepare(self._calibrated_camera())
                self.view.update(self.localizer)

    def on_odometry(self, message: Any) -> None:
        """Use a nav_msgs/Odometry."""
        self._log.count('odom')
        try:
            sample = messages.odometry(message)
        except GipError as error:
            self.refuse('odom', str(error))
            return
        frames = self.parameters.frames
        wrong = messages.other_frame('of', message.child_frame_id, 'frames.base', frames.base) or (
            messages.other_frame('in', message.header.frame_id, 'frames.odom', frames.odom)
        )
        if wrong:
            self.refuse('odom', wrong)
            return
        if self.localizer.add_odometry(sample):
            self._log.accept('odom')
        else:
            self.refuse('odom', self.localizer.state.pose_filter.odometry.refusal)

    def on_initial_pose(self, message: Any) -> None:
        """Use a geometry_msgs/PoseWithCovarianceStamped as the prior."""
        self._log.count('initialpose')
        try:
            self._set_prior(message)
        except GipError as error:
            self.refuse('initialpose', f'{error}; the previous belief is kept')
        else:
            self._log.accept('initialpose')

    def _set_prior(self, message: Any) -> None:
        pose, covariance = prior_of(message, self.parameters, self.localizer.raster_map)
        self.localizer.set_prior(messages.stamp_ns(message.header), pose, covariance)
        sigma = np.sqrt(np.diag(covariance))
        self.report(
            f'initial pose taken: x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {pose.yaw:.4f} rad, '
            f'standard deviations {sigma[0]:.3g} m, {sigma[1]:.3g} m, {sigma[2]:.3g} rad'
        )

    def on_image(self, message: Any, masked: Masked | None = None) -> Estimate:
        """Localize a sensor_msgs/Image; `masked` if `mask.from_topic` is set."""
        return self._on_frame(message, grey_image, masked)

    def on_compressed_image(self, message: Any, masked: Masked | None = None) -> Estimate:
        """Localize a sensor_msgs/CompressedImage in the same way."""
        return self._on_frame(message, compressed_grey_image, masked)

    def _on_frame(
        self, message: Any, decode: Callable[[Any], Grey], masked: Masked | None
    ) -> Estimate:
        self._log.count('image')
        self.warnings, self.image = dict(self._camera.warnings), None
        self.camera_frame = str(message.header.frame_id)
        stamp = messages.stamp_ns(message.header)
        if stamp == 0:
            self._log.count_refused('image')
            return Estimate(stamp, Status.BAD_IMAGE, UNSTAMPED)
        if self._camera.calibration is None:
            wrong = self.complaints.get('camera_info', 'no camera_info received yet')
            return Estimate(stamp, Status.NO_CALIBRATION, wrong)
        try:
            self.image = image = self._images.image(message, decode)
            camera = self._calibrated_camera().for_image(image)
            required = self.parameters.mask.required
            mask = self._images.mask(masked, image, required=required)
        except MaskError as error:
            return Estimate(stamp, Status.NO_MASK, str(error))
        except ImageError as error:
            self._log.count_refused('image')
            return Estimate(stamp, Status.BAD_IMAGE, str(error))
        except CalibrationError as error:
            self._log.count_refused('image')
            return Estimate(stamp, Status.NO_CALIBRATION, str(error))
        finally:
            self.warnings |= self._images.warnings
        pose_filter = self.localizer.state.pose_filter
        self.warnings |= odometry_warnings(stamp, pose_filter)
        if frozen := self._repeats.frozen(stamp, image, pose_filter):
            return Estimate(stamp, Status.FROZEN_IMAGE, frozen)
        if self._repeats.repeats >= LEAST_REPEATS:
            self.warnings['REPEATED_IMAGES'] = f'{self._repeats.repeats} in a row'
        estimate = self.localizer.update(stamp, image, camera, mask=mask)
        self.view.update(self.localizer)
        self.warnings |= self.view.warnings
        return estimate

    def _calibrated_camera(self) -> CameraModel:
        assert self._camera.calibration is not None
        return self._camera.model(self._camera.calibration, self.parameters.camera)
