# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics`: what `HealthMonitor` tells, once a second and when it changes."""

from __future__ import annotations

from collections.abc import Sequence
import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from gip_localizer.session.diagnostic_report import Report
from gip_localizer.session.diagnostic_rules import Severity
from gip_localizer.session.diagnostics import HealthMonitor

CHANGES = 0.2
"""Least seconds between two publications because of a change."""
REPEATED = 30.0
"""Least seconds between two lines of the log about the same state of a group."""
MOST_STATES = 1000
"""States whose times are remembered; messages hold what others sent."""
NUMBER = re.compile(r'[-+]?[0-9][0-9.e+-]*')
"""What changes in the message of a state that stays the same."""


class DiagnosticsPublisher:
    """
    Publishes the statuses of a node, and logs what changes in them.

    Parameters
    ----------
    node : Node
        Publishes and logs.
    health : HealthMonitor
        Asked each time.

    """

    def __init__(self, node: Node, health: HealthMonitor) -> None:
        self._node = node
        self._health = health
        self._publisher = node.create_publisher(
            DiagnosticArray, '/diagnostics', QoSProfile(depth=10)
        )
        self._told: dict[str, str] = {}
        self._told_at = float('-inf')
        self._logged: dict[str, str] = {}
        self._logged_at: dict[tuple[str, str], float] = {}

    def tell_changes(self) -> None:
        """Publish if another rule holds than before, but not at every frame of a flapping one."""
        if self._health.steady() - self._told_at < CHANGES:
            return
        reports = self._health.reports()
        if _rules(reports) != self._told:
            self._publish(reports)

    def tell(self) -> None:
        """Publish."""
        self._publish(self._health.reports())

    def _publish(self, reports: Sequence[Report]) -> None:
        name = self._node.get_fully_qualified_name().lstrip('/')
        self._publisher.publish(DiagnosticArray(
            header=Header(stamp=self._node.get_clock().now().to_msg()),
            status=[_status(name, report) for report in reports],
        ))  # fmt: skip
        self._told, self._told_at = _rules(reports), self._health.steady()
        for report in reports:
            self._log(report)

    def _log(self, report: Report) -> None:
        """Log a state that is not the last one logged, each at most once in `REPEATED`."""
        group, now = report.group.name, self._health.steady()
        said = NUMBER.sub('', report.message) if report.rules else 'OK'
        if said == self._logged.get(group, 'OK'):
            return
        if now - self._logged_at.get((group, said), float('-inf')) < REPEATED:
            return
        if len(self._logged_at) > MOST_STATES:
            self._logged_at.clear()
        self._logged[group] = said
        self._logged_at[group, said] = now
        text = f'{group}: {report.message}'
        # rclpy ties a severity to the line that logs.
        if report.level is Severity.OK:
            self._node.get_logger().info(text)
        else:
            self._node.get_logger().warning(text)


def _rules(reports: Sequence[Report]) -> dict[str, str]:
    return {
        report.group.name: ' '.join(rule.name for rule in report.rules)
        for report in reports
    }


def _status(node: str, report: Report) -> DiagnosticStatus:
    status = DiagnosticStatus(
        level=bytes([report.level]), name=f'{node}: {report.group.name}',
        message=report.message, hardware_id=node,
    )  # fmt: skip
    status.values = [KeyValue(key=key, value=value) for key, value in report.figures.items()]
    return status
