# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Topics and services around a `Dispatch`: the common part of the plain and of the managed node.

For each frame: process waiting messages, localize, publish, report changes. A search of the whole
map takes seconds and is done by a worker; inputs of the localizer wait for its end, while
services, parameters and diagnostics continue.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from rclpy.node import Node

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Parameters
from gip_localizer.ros.localizer.diagnostics import DiagnosticsPublisher
from gip_localizer.ros.localizer.map_in_use import MapInUse, MapService
from gip_localizer.ros.localizer.publishers import Outputs
from gip_localizer.ros.localizer.services import Services
from gip_localizer.ros.localizer.state_reports import StateReports
from gip_localizer.ros.localizer.subscriptions import Inputs
from gip_localizer.ros.localizer.transform_output import TransformOutput
from gip_localizer.ros.localizer.transforms import follow
from gip_localizer.ros.localizer.worker import Worker
from gip_localizer.ros.parameters import warn_of_unknown_qos
from gip_localizer.session.diagnostics import HealthMonitor
from gip_localizer.session.dispatch import Dispatch, IMAGE, MASK, ODOMETRY
from gip_localizer.session.input_checks import rectified_warning
from gip_localizer.session.mask_sync import Frame

MOUNT_LOG = 60.0
"""Least time (s) between two log lines about a new camera pose from TF; chosen."""


class Localization:
    """
    Localizes the frames that a node receives.

    Parameters
    ----------
    node : Node
        Owns topics, services and timers.
    parameters : Parameters
        At the start; `configure` changes them.
    active : bool
        False: images are ignored until `switch`.

    Raises
    ------
    GipError
        A parameter or the map cannot be used.

    """

    def __init__(self, node: Node, parameters: Parameters, *, active: bool = True) -> None:
        self._map = MapInUse(parameters)
        self._node = node
        self._dispatch = Dispatch(
            self._map.raster_map, parameters, node.get_logger().error,
            compressed=parameters.image_transport != 'raw',
        )
        self._dispatch.frontend.report = node.get_logger().info
        self._parameters = parameters
        self._health = HealthMonitor(
            parameters.diagnostics, self._map.figures(), active=active
        )
        self._dispatch.keep_state(partial(self._health.add_event, 'STATE_REFUSED'))
        self._wire()
        self._log_start()

    def _wire(self) -> None:
        node, frames = self._node, self._parameters.frames
        self._outputs = Outputs(node, frames.map, frames.base, self._map.raster_map)
        self._diagnostics = DiagnosticsPublisher(node, self._health)
        self._worker: Worker[Estimate] = Worker(node)
        self._tf: TransformOutput | None = None
        if self._parameters.tf.publish:
            self._tf = TransformOutput(
                node, frames, self._parameters.tf, self._health, self._odometry_at
            )
        if self._parameters.camera.from_tf:
            mount = self._dispatch.follow_transforms(self._report_camera)
            follow(node, lambda message: self._worker.when_free(
                partial(mount.take, message.transforms)
            ))  # fmt: skip
        self._inputs = Inputs(node, self._parameters, self._take, self._take_overdue)
        self._health.publisher_hint = self._inputs.publisher_hint
        self._health.set_rule('RECTIFIED_DIFFERS', rectified_warning(
            self._inputs.image_topic, rectified=self._parameters.camera.rectified
        ))
        self._services = Services(
            node, self._health, self._diagnostics.publish, self._request_search
        )
        self._reports = StateReports(
            node, self._health, self._dispatch, self._diagnostics, self._services.look
        )
        MapService(node, frames.map, lambda: self._map.raster_map)
        warn_of_unknown_qos(node)

    def _log_start(self) -> None:
        raster_map = self._map.raster_map
        rows, cols = raster_map.grey.shape
        self._node.get_logger().info(
            f'map {self._parameters.map_file}: {cols} x {rows} cells of '
            f'{raster_map.resolution:g} m; waiting for {self._inputs.image_topic}'
        )

    def check(self, parameters: Parameters) -> None:
        """
        Load another map before the one in use is given up.

        Raises
        ------
        GipError
            It cannot be read.

        """
        self._map.check(parameters)

    def configure(self, parameters: Parameters) -> None:
        """Take new parameters, or another map, from the next frame on."""
        if self._map.change(parameters):
            self._worker.when_free(partial(self._change_map, parameters))
        self._parameters = parameters
        self._health.limits = parameters.diagnostics
        if self._tf is not None:
            self._tf.settings = parameters.tf
        self._worker.when_free(partial(self._dispatch.configure, parameters))

    def _change_map(self, parameters: Parameters) -> None:
        self._dispatch.change_map(self._map.raster_map, parameters)
        self._outputs.publish_map(self._map.raster_map)
        self._health.fixed = self._map.figures()
        self._log_start()

    def switch(self, on: bool) -> None:
        """Process images (unless disabled by ~/enable), or ignore them."""
        self._health.active = on
        self._diagnostics.publish()

    def close(self) -> None:
        """Stop the clock callback and the worker; the caller removes the endpoints."""
        self._worker.close()
        self._reports.close()

    def _take(self, role: str, message: Any) -> None:
        """Process a message: images and masks now, others when no frame is being localized."""
        if role in (IMAGE, MASK):
            self._queue(self._dispatch.take(role, message, time.monotonic_ns()))
        else:
            self._worker.when_free(partial(self._take_other, role, message))

    def _take_overdue(self) -> None:
        self._queue(self._dispatch.newest_overdue(time.monotonic_ns()))

    def _queue(self, frames: list[Frame]) -> None:
        """Localize frames; of those received during a search only the newest."""
        for frame in frames:
            self._worker.when_free(partial(self._on_frame, frame), instead_of='image')

    def _take_other(self, role: str, message: Any) -> None:
        self._dispatch.take(role, message, time.monotonic_ns())
        if role == ODOMETRY:
            self._health.on_odometry()
        if role != ODOMETRY or role in self._dispatch.frontend.complaints:
            self._reports.publish_changes()

    def _on_frame(self, frame: Frame) -> None:
        self._health.on_image(frame.stamp_ns, self._now_ns())
        if not self._health.accepts_frames:
            return
        started = time.perf_counter()
        self._inputs.take_waiting_odometry()
        if self._dispatch.frontend.view_outdated:
            self._health.set_rule('VIEW_BUILDING', 'since this frame')
            self._diagnostics.publish()
        searches = self._dispatch.begin(frame)
        self._health.frame_started(search=searches)
        work, finish = partial(self._dispatch.localize, frame), partial(self._finish, started)
        if searches:
            self._worker.start(work, finish)
        else:
            finish(work())

    def _finish(self, started: float, estimate: Estimate) -> None:
        elapsed_ms = 1e3 * (time.perf_counter() - started)
        self._health.set_rule('VIEW_BUILDING', '')
        if self._health.accepts_frames:
            self._publish(estimate, elapsed_ms)
        self._health.frame_finished(estimate, elapsed_ms)
        self._services.take(estimate)
        state = self._dispatch.frontend.localizer.state
        if seconds := state.stamps.went_back:
            self._health.on_time_jump(seconds)
        self._health.prediction = state.pose_filter.prediction_source
        self._health.warnings = self._dispatch.frontend.warnings
        self._health.overtaken = self._dispatch.overtaken
        self._reports.publish_changes()

    def _publish(self, estimate: Estimate, elapsed_ms: float) -> None:
        self._outputs.publish(estimate, elapsed_ms, self._dispatch.attitude)
        if self._tf is not None:
            self._tf.publish(estimate)
        self._outputs.publish_pictures(
            estimate, self._parameters.frames.base, self._dispatch.frontend
        )
        self._dispatch.end(estimate)

    def _odometry_at(self, stamp_ns: int) -> Pose2 | None:
        pose_filter = self._dispatch.frontend.localizer.state.pose_filter
        return pose_filter.odometry.pose_at(stamp_ns)

    def _report_camera(self, place: str) -> None:
        self._node.get_logger().info(f'camera from TF: {place}', throttle_duration_sec=MOUNT_LOG)

    def _request_search(self, then: Callable[[], None]) -> None:
        def search() -> None:
            self._node.get_logger().info('search of the whole map requested, for the next frame')
            self._dispatch.relocalize()
            then()

        self._worker.when_free(search)

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
