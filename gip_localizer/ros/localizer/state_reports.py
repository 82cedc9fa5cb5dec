# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Reports of the node's state: after each message, and without one (missing inputs, clock)."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.clock import Clock, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node

from gip_localizer.ros.endpoints import namesakes
from gip_localizer.ros.localizer.diagnostics import DiagnosticsPublisher
from gip_localizer.session.diagnostics import HealthMonitor
from gip_localizer.session.dispatch import Dispatch

CHECK_PERIOD = 0.2
"""Period (s) of the check for missing inputs; chosen: a fifth of the reporting period."""
CHECKS_PER_REPORT = 5
"""Number of these checks per report: one report per second."""


class StateReports:
    """
    Brings the health monitor up to date, and publishes and logs what changed.

    Parameters
    ----------
    node : Node
        Owns clock, timer and log.
    health : HealthMonitor
        Judges the state.
    dispatch : Dispatch
        Knows faults and counts of the messages, the view, and the camera's pose from TF.
    publisher : DiagnosticsPublisher
        Publishes the health.
    checks : callable
        Called at each check in addition.

    """

    def __init__(
        self, node: Node, health: HealthMonitor, dispatch: Dispatch,
        publisher: DiagnosticsPublisher, checks: Callable[[], object],
    ) -> None:
        self._node, self._health, self._dispatch = node, health, dispatch
        self._publisher, self._checks = publisher, checks
        self._count = 0
        self._view_number = 0
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(CHECK_PERIOD, self._check, clock=steady)
        back = JumpThreshold(min_forward=None, min_backward=Duration(nanoseconds=-1),
                             on_clock_change=False)
        self._jumps = node.get_clock().create_jump_callback(back, post_callback=self._on_jump)

    def close(self) -> None:
        """Stop the callback of the clock; the node removes the timer."""
        self._jumps.unregister()

    def publish_changes(self) -> None:
        """Log a new view, and publish the diagnostics whose status changed."""
        self._log_view()
        self._update_inputs()
        self._publisher.publish_changes()

    def _log_view(self) -> None:
        """Log each view when it is computed."""
        view = self._dispatch.frontend.view
        if view.number != self._view_number:
            self._view_number = view.number
            self._node.get_logger().info(f'{view.text}; computed in {view.seconds:.1f} s')

    def _update_inputs(self) -> None:
        frontend, mount = self._dispatch.frontend, self._dispatch.mount
        self._health.update_inputs(frontend.complaints, frontend.counts)
        self._health.set_rule('NO_CAMERA_TF', '' if mount is None else mount.fault)

    def _check(self) -> None:
        """Check for missing inputs; publish all reports once a second."""
        clock = self._node.get_clock()
        self._health.simulated = bool(clock.ros_time_is_active)
        self._health.on_clock(int(clock.now().nanoseconds))
        self._update_inputs()
        self._checks()
        if self._count % CHECKS_PER_REPORT == 0:
            self._health.set_rule('DUPLICATE_NAME', namesakes(self._node))
        self._count += 1
        if self._count % CHECKS_PER_REPORT == 1:
            self._publisher.publish()
        else:
            self._publisher.publish_changes()

    def _on_jump(self, jump: TimeJump) -> None:
        self._health.on_time_jump(-jump.delta.nanoseconds * 1e-9)
