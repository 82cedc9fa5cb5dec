# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Topics and services around a `Frontend`: the working part of the node, plain or managed.

A frame goes: take what waits, localize, publish, tell what has changed. A search of the whole
map, which takes seconds, is done by a worker; what groups the localizer waits for it, while
services, parameters and diagnostics are answered.

"""

from __future__ import annotations

from functools import partial
import time
from typing import Any

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from gip_localizer.core.camera.model import Extrinsics
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.guard import run_guarded
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import ParameterError
from gip_localizer.io.map_files import load_map
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters import Parameters
from gip_localizer.ros.localizer.diagnostics import DiagnosticsPublisher
from gip_localizer.ros.localizer.publishers import Outputs
from gip_localizer.ros.localizer.subscriptions import Inputs, Localize
from gip_localizer.ros.localizer.transforms import CameraFromTf, MapToOdom
from gip_localizer.ros.localizer.worker import Worker
from gip_localizer.ros.parameters import warn_of_unknown_qos
from gip_localizer.session.diagnostics import HealthMonitor
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.pose_file import map_hash
from gip_localizer.session.pose_restore import StateKeeper

LOOK = 0.2
"""Seconds between two looks at what has become silent."""
LOOKS_PER_REPORT = 5


class Localization:
    """
    Localizes the frames that a node hears.

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
        raster_map = _map_of(parameters)
        self._node = node
        self._frontend = Frontend(raster_map, parameters)
        self._parameters = parameters
        self._extrinsics: Extrinsics | None = None
        self._health = HealthMonitor(
            parameters.diagnostics, _map_figures(raster_map), active=active
        )
        self._keeper = StateKeeper(
            self._frontend.localizer, partial(self._health.happened, 'STATE_REFUSED')
        )
        self._wire(raster_map)
        self._say_hello(raster_map)

    def _wire(self, raster_map: RasterMap) -> None:
        node, frames = self._node, self._parameters.frames
        self._outputs = Outputs(node, frames.map, raster_map)
        self._diagnostics = DiagnosticsPublisher(node, self._health)
        self._worker: Worker[Estimate] = Worker(node)
        self._tf = None
        if self._parameters.tf.publish:
            self._tf = MapToOdom(node, frames.map, frames.odom)
        self._camera_tf = None
        if self._parameters.camera.from_tf:
            self._camera_tf = CameraFromTf(node, frames.base, self._place_camera, self._no_camera)
        self._inputs = Inputs(
            node, self._frontend, self._on_frame, self._on_other, self._worker.when_free
        )
        node.create_service(Trigger, '~/relocalize', self._on_relocalize)
        node.create_service(SetBool, '~/enable', self._on_enable)
        warn_of_unknown_qos(node)
        self._looks = 0
        node.create_timer(LOOK, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                             on_clock_change=False)
        self._jumps = node.get_clock().create_jump_callback(back, post_callback=self._on_jump)

    def _say_hello(self, raster_map: RasterMap) -> None:
        rows, cols = raster_map.grey.shape
        self._node.get_logger().info(
            f'map {self._parameters.map_file}: {cols} x {rows} cells of '
            f'{raster_map.resolution:g} m; waiting for {self._node.resolve_topic_name("image")}'
        )

    def configure(self, parameters: Parameters) -> None:
        """Take new parameters from the next frame on."""
        self._parameters = parameters
        self._health.limits = parameters.diagnostics
        self._worker.when_free(
            lambda: self._frontend.configure(_placed(parameters, self._extrinsics))
        )

    def switch(self, on: bool) -> None:
        """Take images unless ~/enable forbids it, or ignore them."""
        self._health.active = on
        self._diagnostics.tell()

    def close(self) -> None:
        """Let go of clock and worker; the node's endpoints are the caller's affair."""
        self._worker.close()
        self._jumps.unregister()

    def _on_frame(self, localize: Localize, message: Any) -> None:
        stamp = stamp_ns(message.header)
        self._health.image_came(stamp, self._now_ns())
        if not self._health.wanted:
            return
        started = time.perf_counter()
        self._inputs.take_waiting_odometry()
        self._keeper.before(stamp)
        searches = self._frontend.localizer.searches(stamp)
        self._health.begins(search=searches)
        log = self._node.get_logger().error
        work = partial(run_guarded, partial(localize, message), stamp, log)
        finish = partial(self._finish, started)
        if unplaced := self._unplaced(message):
            finish(unplaced)
        elif searches:
            self._worker.start(work, finish)
        else:
            finish(work())

    def _finish(self, started: float, estimate: Estimate) -> None:
        elapsed_ms = 1e3 * (time.perf_counter() - started)
        if self._health.wanted:
            self._publish(estimate, elapsed_ms)
        self._health.took(estimate, elapsed_ms)
        if seconds := self._frontend.localizer.state.stamps.went_back:
            self._health.time_went_back(seconds)
        self._health.prediction = self._frontend.localizer.state.pose_filter.prediction_source
        self._health.warnings = self._frontend.warnings
        self._health.overtaken = self._inputs.overtaken
        self._tell_changes()

    def _publish(self, estimate: Estimate, elapsed_ms: float) -> None:
        self._outputs.publish(estimate, elapsed_ms)
        self._publish_transform(estimate)
        self._outputs.publish_pictures(
            estimate, self._parameters.frames.base, self._frontend
        )
        self._keeper.after(estimate)

    def _unplaced(self, message: Any) -> Estimate | None:
        """Return why a frame cannot be localized while TF does not tell where the camera is."""
        if self._camera_tf is None:
            return None
        self._camera_tf.seen_in(str(message.header.frame_id))
        if self._camera_tf.known:
            return None
        return Estimate(stamp_ns(message.header), Status.NO_CALIBRATION, (
            f'camera.from_tf: {self._health.lasting.get("NO_CAMERA_TF", "")}'
        ))

    def _publish_transform(self, estimate: Estimate) -> None:
        if self._tf is None or estimate.pose is None:
            return
        odometry = self._frontend.localizer.state.pose_filter.odometry.pose_at(estimate.stamp_ns)
        if odometry is None:
            self._health.lasting['NO_TF'] = 'no odometry at the stamp of the image'
            return
        self._health.lasting.pop('NO_TF', None)
        tolerance = self._parameters.tf.tolerance
        self._tf.publish(estimate.stamp_ns, tolerance, estimate.pose, odometry)

    def _on_other(self, topic: str, message: Any) -> None:
        if topic == 'odom':
            self._health.odometry_came()
        elif topic == 'initialpose' and topic not in self._frontend.complaints:
            self._keeper.forget()
        elif topic == 'camera_info' and self._camera_tf is not None:
            self._camera_tf.seen_in(str(message.header.frame_id))
        if topic != 'odom' or topic in self._frontend.complaints:
            self._tell_changes()

    def _place_camera(self, extrinsics: Extrinsics) -> None:
        placed = _placed(self._parameters, extrinsics)
        self._worker.when_free(lambda: self._frontend.configure(placed))
        self._extrinsics = extrinsics
        numbers = ', '.join(f'{name} {value:.4g}' for name, value in vars(extrinsics).items())
        self._node.get_logger().info(f'camera from TF: {numbers}')

    def _no_camera(self, why: str | None) -> None:
        if why is None:
            self._health.lasting.pop('NO_CAMERA_TF', None)
        else:
            self._health.lasting['NO_CAMERA_TF'] = why

    def _on_jump(self, jump: TimeJump) -> None:
        self._health.time_went_back(-jump.delta.nanoseconds * 1e-9)

    def _tell_changes(self) -> None:
        self._health.hear(self._frontend.complaints, self._frontend.counts)
        self._diagnostics.tell_changes()

    def _look(self) -> None:
        """Notice silence soon; tell all once a second."""
        self._health.simulated = bool(self._node.get_clock().ros_time_is_active)
        self._health.clock_shows(self._now_ns())
        self._health.hear(self._frontend.complaints, self._frontend.counts)
        self._looks += 1
        if self._looks % LOOKS_PER_REPORT == 1:
            self._diagnostics.tell()
        else:
            self._diagnostics.tell_changes()

    def _on_relocalize(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self._worker.when_free(self._relocalize)
        response.success = True
        response.message = 'the next frame is searched for in the whole map'
        return response

    def _relocalize(self) -> None:
        self._frontend.relocalize()
        self._keeper.forget()

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._health.enabled = bool(request.data)
        self._diagnostics.tell()
        response.success = True
        response.message = 'enabled' if request.data else 'disabled'
        if not self._health.active:
            response.message += '; the node is not active, and images are ignored until it is'
        return response

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)


def _placed(parameters: Parameters, extrinsics: Extrinsics | None) -> Parameters:
    """Return the parameters with the camera where TF has it (raises ParameterError)."""
    if extrinsics is None:
        return parameters
    numbers = vars(extrinsics).items()
    return parameters.replace({f'camera.{name}': value for name, value in numbers})


def _map_of(parameters: Parameters) -> RasterMap:
    if not parameters.map_file:
        raise ParameterError(
            'parameter map_file: is empty, expected the path of a nav2 map YAML; '
            'start with: --ros-args -p map_file:=/path/to/map.yaml'
        )
    return load_map(parameters.map_file)


def _map_figures(raster_map: RasterMap) -> dict[str, str]:
    rows, cols = raster_map.grey.shape
    return {
        'map_cells': f'{cols} x {rows}', 'map_resolution': f'{raster_map.resolution:g}',
        'map_hash': map_hash(raster_map),
    }
