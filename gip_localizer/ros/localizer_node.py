# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `localizer`: camera image in, pose out; all else is in `gip_localizer.core`."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
import sys
import time
from typing import TypeVar

from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from std_srvs.srv import SetBool, Trigger

from gip_localizer.core.estimate import Estimate
from gip_localizer.errors import ParameterError
from gip_localizer.io.frontend import Frontend
from gip_localizer.io.map_files import load_map
from gip_localizer.parameters import Parameters
from gip_localizer.ros.diagnostics import Health, OK, State
from gip_localizer.ros.outputs import Outputs
from gip_localizer.ros.parameters import LiveParameters
from gip_localizer.ros.running import run_node

Message = TypeVar('Message')
ODOMETRY_KEPT = 1000
"""Messages that may wait while a frame is localized; older ones are dropped."""


class LocalizerNode(Node):
    """
    Wires topics and services to a `Frontend`.

    Raises
    ------
    GipError
        A parameter or the map cannot be used.

    """

    def __init__(self) -> None:
        super().__init__('localizer')
        self._live = LiveParameters(self, Parameters, lambda new: self._frontend.configure(new))
        parameters = self._live.value
        if not parameters.map_file:
            raise ParameterError(
                'parameter map_file: is empty, expected the path of a nav2 map YAML; '
                'start with: --ros-args -p map_file:=/path/to/map.yaml'
            )
        raster_map = load_map(parameters.map_file)
        self._frontend = Frontend(raster_map, parameters)
        self._health = Health()
        self._outputs = Outputs(self, parameters.frames.map, raster_map)
        self._told: State | None = None
        self._subscribe(parameters)
        self.create_service(Trigger, '~/relocalize', self._on_relocalize)
        self.create_service(SetBool, '~/enable', self._on_enable)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(1.0, self._tell, clock=steady)
        rows, cols = raster_map.grey.shape
        self.get_logger().info(
            f'map {parameters.map_file}: {cols} x {rows} cells of {raster_map.resolution:g} m; '
            f'waiting for {self.resolve_topic_name("image")}'
        )

    def _subscribe(self, parameters: Parameters) -> None:
        camera = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        if parameters.image_reliability == 'reliable':
            camera.reliability = ReliabilityPolicy.RELIABLE
        frontend = self._frontend
        # Before the image: of messages that wait, the executor takes them in this order.
        self._listen(CameraInfo, 'camera_info', frontend.on_camera_info, qos_profile_sensor_data)
        if parameters.image_transport == 'compressed':
            use = partial(self._on_frame, frontend.on_compressed_image)
            self.create_subscription(CompressedImage, 'image/compressed', use, camera)
        else:
            use = partial(self._on_frame, frontend.on_image)
            self.create_subscription(Image, 'image', use, camera)
        self._odometry = self.create_subscription(
            Odometry, 'odom', frontend.on_odometry,
            QoSProfile(depth=ODOMETRY_KEPT, reliability=ReliabilityPolicy.BEST_EFFORT),
        )  # fmt: skip
        self._listen(
            PoseWithCovarianceStamped, 'initialpose', frontend.on_initial_pose, QoSProfile(depth=1)
        )

    def _listen(
        self, kind: type[Message], topic: str, use: Callable[[Message], None], qos: QoSProfile
    ) -> None:
        def take(message: Message) -> None:
            use(message)
            self._tell_changes()

        self.create_subscription(kind, topic, take, qos)

    def _on_frame(self, localize: Callable[[Message], Estimate], message: Message) -> None:
        self._health.image_at = time.monotonic()
        if not self._health.enabled:
            return
        started = time.perf_counter()
        self._take_odometry()
        estimate = localize(message)
        elapsed_ms = 1e3 * (time.perf_counter() - started)
        self._health.took(estimate, elapsed_ms)
        self._outputs.publish(estimate, elapsed_ms)
        self._outputs.publish_pictures(estimate, self._live.value.frames.base)
        self._tell_changes()

    def _take_odometry(self) -> None:
        """Take what the executor has not come to yet: it may hand an image out first."""
        handle = self._odometry.handle
        with handle:
            while (taken := handle.take_message(Odometry, False)) is not None:
                self._frontend.on_odometry(taken[0])

    def _tell_changes(self) -> None:
        self._health.hear(self._frontend.complaints)
        if self._health.state() != self._told:
            self._tell()

    def _tell(self) -> None:
        """Publish diagnostics, and log what has changed in them."""
        self._health.hear(self._frontend.complaints)
        state = self._health.state()
        if state.word != (self._told.word if self._told is not None else ''):
            self._log(state)
        self._told = state
        self._outputs.tell(self._health)

    def _log(self, state: State) -> None:
        # rclpy ties a severity to the line that logs.
        if state.level == OK:
            self.get_logger().info(str(state))
        else:
            self.get_logger().warning(str(state))

    def _on_relocalize(
        self, _request: Trigger.Request, response: Trigger.Response
    ) -> Trigger.Response:
        self._frontend.relocalize()
        response.success = True
        response.message = 'the next frame is searched for in the whole map'
        return response

    def _on_enable(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._health.enabled = bool(request.data)
        response.success = True
        response.message = 'enabled' if request.data else 'disabled'
        self._tell()
        return response


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit code is 0 after an orderly end."""
    return run_node(LocalizerNode, 'localizer', args)


if __name__ == '__main__':
    sys.exit(main())
