# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
From a message to estimates: the processing that the node and `gip replay` share.

Each message has a role: the name of the node's topic for it. For images, frames that are ready to
be localized are returned; every other message is processed at once. The node localizes a frame
when its worker is free, the replay at once; the processing of the frame is the same.

"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.guard import fault_of, run_guarded
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.io.image_stream import ImageStream
from gip_localizer.parameters import Parameters
from gip_localizer.session.attitude import AttitudeSource
from gip_localizer.session.camera_mount import CameraMount, with_camera
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.mask_sync import Frame, frames_of, Masked, MaskPairing
from gip_localizer.session.pose_restore import StateKeeper

IMAGE, MASK = 'image', 'mask'
CAMERA_INFO, ODOMETRY, INITIAL_POSE = 'camera_info', 'odom', 'initialpose'


class Dispatch:
    """
    Passes each message to the part of the localizer that uses it.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    parameters : Parameters
        Initial values; `configure` changes them.
    log : callable
        Takes the traceback of an unexpected exception.
    compressed : bool
        Whether the images are sensor_msgs/CompressedImage.

    Raises
    ------
    MapError
        `mask_file` is set and cannot be read.

    Attributes
    ----------
    frontend : Frontend
        Decodes the messages and holds the localizer.
    attitude : AttitudeSource
        z, roll and pitch of the poses.
    mount : CameraMount or None
        Camera pose from TF, once `follow_transforms` was called.
    first_complaints : dict
        Role → reason of the first refused message.

    """

    def __init__(
        self, raster_map: RasterMap, parameters: Parameters, log: Callable[[str], object], *,
        compressed: bool = False,
    ) -> None:
        self.frontend = Frontend(raster_map, parameters)
        self.attitude = AttitudeSource(parameters.attitude)
        self.mount: CameraMount | None = None
        self.first_complaints: dict[str, str] = {}
        self._parameters = parameters
        self._log = log
        self._keeper: StateKeeper | None = None
        self._warn: Callable[[str], object] = log
        decode = self.frontend.on_compressed_image if compressed else self.frontend.on_image
        self._decode: Callable[[Any, Masked | None], Estimate] = decode
        self._stream = ImageStream()
        self._others: dict[str, Callable[[Any], None]] = {
            CAMERA_INFO: self._take_camera_info, ODOMETRY: self._take_odometry,
            INITIAL_POSE: self._take_initial_pose,
        }
        self._pairing: MaskPairing | None = None
        if parameters.mask.from_topic:
            self._pairing = MaskPairing(lambda: self.frontend.parameters.mask)

    def keep_state(self, warn: Callable[[str], object]) -> None:
        """Restore the pose of `state_file` and save it from now on; `warn` takes errors."""
        self._warn = warn
        self._keeper = StateKeeper(self.frontend.localizer, warn)

    def follow_transforms(self, report: Callable[[str], object]) -> CameraMount:
        """Take the camera pose from TF from now on; `report` takes each new pose."""
        self.mount = CameraMount(self._parameters.frames.base, self._place_camera, report)
        return self.mount

    def configure(self, parameters: Parameters) -> None:
        """Use new parameters from the next frame on; a camera pose from TF is kept."""
        self._parameters = parameters
        extrinsics = None if self.mount is None else self.mount.extrinsics
        self.frontend.configure(with_camera(parameters, extrinsics))
        self.attitude.settings = parameters.attitude

    def change_map(self, raster_map: RasterMap, parameters: Parameters) -> None:
        """Use another map from the next frame on."""
        self.configure(parameters)
        self.frontend.change_map(raster_map, self.frontend.parameters)
        if self._keeper is not None:
            self.keep_state(self._warn)
        if parameters.map_keeps_pose:
            self._forget_restored()

    def relocalize(self) -> None:
        """Search the whole map at the next frame; discard a restored pose."""
        self.frontend.relocalize()
        self._forget_restored()

    @property
    def overtaken(self) -> int:
        """Number of images dropped because a newer image had its mask first."""
        return 0 if self._pairing is None else self._pairing.dropped

    def estimates(self, role: str, message: Any, now_ns: int) -> Iterator[tuple[Frame, Estimate]]:
        """
        Process a message and localize every frame that is ready with it.

        Parameters
        ----------
        role : str
            IMAGE, MASK, CAMERA_INFO, ODOMETRY or INITIAL_POSE.
        message : Any
            A message of rclpy or rosbags.
        now_ns : int
            Time of a steady clock, for `mask.timeout`.

        """
        for frame in [*self.overdue(now_ns), *self.take(role, message, now_ns)]:
            self.begin(frame)
            yield frame, self.localize(frame)

    def rest(self) -> Iterator[tuple[Frame, Estimate]]:
        """Localize the images that still wait for a mask, at the end of the input."""
        for masked in self._pairing.flush() if self._pairing is not None else ():
            frame = Frame(masked.image, masked)
            self.begin(frame)
            yield frame, self.localize(frame)

    def take(self, role: str, message: Any, now_ns: int) -> list[Frame]:
        """
        Process a message; return the frame that is ready with it, or an empty list.

        While another thread localizes a frame, only images and masks are allowed here.

        """
        if role == IMAGE:
            message = self._stream.taken(message)
            if self._pairing is None:
                return [Frame(message)]
            return frames_of(self._pairing.add_image(message, now_ns))
        if role == MASK:
            return frames_of(self._pairing.add_mask(message)) if self._pairing is not None else []
        if fault := fault_of(partial(self._others[role], message), self._log):
            self.frontend.refuse(role, fault)
        if role in self.frontend.complaints:
            self.first_complaints.setdefault(role, self.frontend.complaints[role])
        return []

    def overdue(self, now_ns: int) -> list[Frame]:
        """Return, oldest first, the images whose waiting time for a mask is over."""
        waited = self._pairing.overdue(now_ns) if self._pairing is not None else []
        return [Frame(masked.image, masked) for masked in waited]

    def newest_overdue(self, now_ns: int) -> list[Frame]:
        """Return only the newest of them, for a caller that must keep up with the camera."""
        frames = self.overdue(now_ns)
        if self._pairing is not None:
            self._pairing.dropped += max(len(frames) - 1, 0)
        return frames[-1:]

    def begin(self, frame: Frame) -> bool:
        """Prepare for a frame; return whether the whole map is searched for it."""
        if self._keeper is not None:
            self._keeper.before(frame.stamp_ns)
        if self.mount is not None:
            self.mount.take_frame_id(str(frame.message.header.frame_id))
        return self.frontend.localizer.searches(frame.stamp_ns)

    def localize(self, frame: Frame) -> Estimate:
        """Localize a frame after `begin`; an unexpected exception costs only this frame."""
        if self.mount is not None and self.mount.fault:
            return Estimate(
                frame.stamp_ns, Status.NO_CALIBRATION, f'camera.from_tf: {self.mount.fault}'
            )
        work = partial(self._decode, frame.message, frame.masked)
        return run_guarded(work, frame.stamp_ns, self._log)

    def end(self, estimate: Estimate) -> None:
        """Save the pose of a frame for a restart."""
        if self._keeper is not None:
            self._keeper.after(estimate)

    def _take_camera_info(self, message: Any) -> None:
        if self.mount is not None:
            self.mount.take_frame_id(str(message.header.frame_id))
        self.frontend.on_camera_info(message)

    def _take_odometry(self, message: Any) -> None:
        self.frontend.on_odometry(message)
        if ODOMETRY not in self.frontend.complaints:
            self.attitude.take(ODOMETRY, message.pose.pose)

    def _take_initial_pose(self, message: Any) -> None:
        self.frontend.on_initial_pose(message)
        if INITIAL_POSE not in self.frontend.complaints:
            self.attitude.take(INITIAL_POSE, message.pose.pose)
            self._forget_restored()

    def _forget_restored(self) -> None:
        if self._keeper is not None:
            self._keeper.forget()

    def _place_camera(self, extrinsics: Extrinsics) -> None:
        self.frontend.configure(with_camera(self._parameters, extrinsics))
