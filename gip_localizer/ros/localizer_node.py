# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `localizer`: camera image in, pose out; plain, or managed where `lifecycle` is set."""

from __future__ import annotations

from collections.abc import Sequence
import sys
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node

from gip_localizer.errors import GipError
from gip_localizer.parameters import Parameters
from gip_localizer.ros.endpoints import Endpoints
from gip_localizer.ros.localizer.bond import AVAILABLE, Bond, MISSING
from gip_localizer.ros.localizer.localization import Localization
from gip_localizer.ros.parameters import given_at_start, LiveParameters
from gip_localizer.ros.running import run_node

NAME = 'localizer'
EXAMPLE = '-p map_file:=/maps/road.yaml -p camera.z:=1.5 -p camera.pitch:=0.26'


class LocalizerNode(Node):
    """
    Localizes from the start.

    Raises
    ------
    GipError
        A parameter or the map cannot be used.

    """

    def __init__(self) -> None:
        super().__init__(NAME)
        self._live = LiveParameters(
            self, Parameters, lambda new: self._running.configure(new),
            check=lambda new: self._running.check(new),
        )  # fmt: skip
        self._running = Localization(self, self._live.value)


class ManagedLocalizerNode(LifecycleNode):
    """
    The same as a lifecycle node: configure loads the map, activate takes images.

    A map that cannot be used fails the transition, with its reason in the log, and the node stays
    unconfigured. While it is inactive it listens to camera_info, odometry and initialpose, so
    that it starts at the given pose.

    """

    def __init__(self) -> None:
        super().__init__(NAME)
        [service] = [one for one in self.services if one.srv_name.endswith('/change_state')]
        self._change_state, service.callback = service.callback, self._on_change_state
        self._running: Localization | None = None
        self._live = LiveParameters(
            self, Parameters, self._retune, fixed=lambda: self._running is not None,
            check=lambda new: self._running.check(new) if self._running is not None else None,
        )  # fmt: skip
        self._bond: Bond | None = None
        if self._live.value.bond_heartbeat_period and not AVAILABLE:
            self.get_logger().info(MISSING)
        if self._live.value.autostart_node:
            self._starter = self.create_timer(
                0.0, self._autostart, clock=Clock(clock_type=ClockType.STEADY_TIME)
            )

    def _autostart(self) -> None:
        """Configure and activate, once the executor runs."""
        self.destroy_timer(self._starter)
        if self.trigger_configure() is TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def _on_change_state(self, request: Any, response: Any) -> Any:
        """Refuse a transition that the state does not have; rclpy 7.1 would end the process."""
        try:
            return self._change_state(request, response)
        except RuntimeError as error:  # rcl's error
            self.get_logger().error(str(error))
            response.success = False
            return response

    def _retune(self, parameters: Parameters) -> None:
        if self._running is not None:
            self._running.configure(parameters)

    def on_configure(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Load the map and join the topics; images are ignored."""
        self._endpoints = Endpoints(self)
        try:
            self._running = Localization(self, self._live.value, active=False)
        except GipError as error:
            self.get_logger().error(str(error))
            self._endpoints.remove_later_ones()
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Take images."""
        self._switch(on=True)
        period = self._live.value.bond_heartbeat_period
        if period and AVAILABLE:
            self._bond = Bond(self, period)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ignore images; the belief stays."""
        self._switch(on=False)
        self._unbind()
        return super().on_deactivate(state)

    def on_cleanup(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the topics and forget the map."""
        self._leave()
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, _state: LifecycleState) -> TransitionCallbackReturn:
        """Leave the topics; the process ends with Ctrl-C."""
        self._leave()
        return TransitionCallbackReturn.SUCCESS

    def _switch(self, *, on: bool) -> None:
        if self._running is not None:
            self._running.switch(on)

    def destroy_node(self) -> None:
        """Part from the lifecycle manager, and leave the graph."""
        self._unbind()
        super().destroy_node()

    def _unbind(self) -> None:
        if self._bond is not None:
            self._bond.close()
            self._bond = None

    def _leave(self) -> None:
        self._unbind()
        if self._running is not None:
            self._running.close()
            self._running = None
            self._endpoints.remove_later_ones()


def _make() -> Node:
    """Build the node of the kind that the parameter `lifecycle` selects."""
    temporary = Node(NAME, enable_rosout=False, start_parameter_services=False)
    asked = given_at_start(temporary).get('lifecycle')
    temporary.destroy_node()
    managed = asked is not None and asked.value is True
    return ManagedLocalizerNode() if managed else LocalizerNode()


def main(args: Sequence[str] | None = None) -> int:
    """Run the node; the exit code is 0 after an orderly end."""
    return run_node(_make, NAME, args, example=EXAMPLE)


if __name__ == '__main__':
    sys.exit(main())
