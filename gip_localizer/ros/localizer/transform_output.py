# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The transform from map to odom: published with each pose, repeated in between."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from gip_localizer.core.estimate import Estimate
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters.integration import Frames, Transforms
from gip_localizer.ros.localizer.transforms import MapToOdom
from gip_localizer.session.diagnostics import HealthMonitor

REPEAT_PERIOD = 0.1
"""Period (s) of the repeated transform (design choice: the usual rate of transforms, 10 Hz)."""


class TransformOutput:
    """
    Publishes where odometry starts in the map.

    Parameters
    ----------
    node : Node
        Publishes.
    frames : Frames
        Names of map and odom.
    settings : Transforms
        How far ahead transforms are stamped, and how long the last one is repeated.
    health : HealthMonitor
        Reports `NO_TF` and `TF_CONTESTED`.
    odometry_at : callable
        Takes a stamp (ns), returns base in odom there; None: unknown.

    """

    def __init__(
        self, node: Node, frames: Frames, settings: Transforms, health: HealthMonitor,
        odometry_at: Callable[[int], Pose2 | None],
    ) -> None:
        self._node, self._health, self._odometry_at = node, health, odometry_at
        self.settings = settings
        contested = partial(health.add_event, 'TF_CONTESTED')
        self._tf = MapToOdom(node, frames.map, frames.odom, contested)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        node.create_timer(REPEAT_PERIOD, self._repeat, clock=steady)

    def publish(self, estimate: Estimate) -> None:
        """Publish the transform of a pose; without odometry at its stamp report `NO_TF`."""
        if estimate.pose is None:
            return
        odometry = self._odometry_at(estimate.stamp_ns)
        self._health.set_rule('NO_TF', '' if odometry else 'no odometry at the stamp of the image')
        if odometry is not None:
            self._tf.publish(estimate.stamp_ns, self._now_ns(), self.settings.tolerance,
                             estimate.pose, odometry)

    def _repeat(self) -> None:
        """Repeat the last transform while it is valid, for slow cameras and withheld frames."""
        hold = self.settings.hold
        if not (hold and self._health.published) or 'NO_TF' in self._health.lasting:
            return
        if not self._tf.repeat(self._now_ns(), self.settings.tolerance, hold):
            self._health.set_rule('NO_TF', f'no pose for tf.hold, {hold:g} s')

    def _now_ns(self) -> int:
        return int(self._node.get_clock().now().nanoseconds)
