# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`/diagnostics`: the reports of `HealthMonitor`, once a second and on change."""

from __future__ import annotations

from collections.abc import Sequence
import re

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from gip_localizer.session.diagnostic_report import Report
from gip_localizer.session.diagnostic_types import Severity
from gip_localizer.session.diagnostics import HealthMonitor

CHANGES = 0.2
"""Least time (s) between two publications because of a change; chosen."""
REPEATED = 30.0
"""Least time (s) between the first and the second log line about one state of a group; chosen."""
LONGEST = 600.0
"""The same for a state that recurs: the time doubles with each line up to this (s); chosen."""
FORGOTTEN = 4.0
"""Multiple of that time after which a state is logged as if for the first time; chosen."""
MOST_STATES = 1000
"""Largest number of stored states; chosen, since messages contain text from other nodes."""
NUMBER = re.compile(r'[-+]?[0-9][0-9.e+-]*')
"""Numbers, which may change in the message of an unchanged state."""


class DiagnosticsPublisher:
    """
    Publishes the statuses of a node, and logs their changes.

    Parameters
    ----------
    node : Node
        Publishes and logs.
    health : HealthMonitor
        Source of the reports.

    """

    def __init__(self, node: Node, health: HealthMonitor) -> None:
        self._node = node
        self._health = health
        self._publisher = node.create_publisher(
            DiagnosticArray, '/diagnostics', QoSProfile(depth=10)
        )
        self._published: dict[str, str] = {}
        self._published_at = float('-inf')
        self._logged: dict[str, str] = {}
        self._logged_at: dict[tuple[str, str], tuple[float, float]] = {}

    def publish_changes(self) -> None:
        """Publish if the set of rules has changed, at most once in `CHANGES`."""
        if self._health.steady() - self._published_at < CHANGES:
            return
        reports = self._health.reports()
        if _rules(reports) != self._published:
            self._publish(reports)

    def publish(self) -> None:
        """Publish all reports."""
        self._publish(self._health.reports())

    def _publish(self, reports: Sequence[Report]) -> None:
        name = self._node.get_fully_qualified_name().lstrip('/')
        self._publisher.publish(DiagnosticArray(
            header=Header(stamp=self._node.get_clock().now().to_msg()),
            status=[_status(name, report) for report in reports],
        ))  # fmt: skip
        self._published, self._published_at = _rules(reports), self._health.steady()
        for report in reports:
            self._log(report)

    def _log(self, report: Report) -> None:
        """Log a state that is not the last one logged, unless it was logged not long ago."""
        group, now = report.group.name, self._health.steady()
        message = NUMBER.sub('', report.message) if report.rules else 'OK'
        if message == self._logged.get(group, 'OK'):
            return
        if not self._due(group, message, now):
            return
        self._logged[group] = message
        text = f'{group}: {report.message}'
        # rclpy ties a severity to the line that logs.
        if report.level is Severity.OK:
            self._node.get_logger().info(text)
        else:
            self._node.get_logger().warning(text)

    def _due(self, group: str, message: str, now: float) -> bool:
        """Whether a state may be logged; one that comes again and again waits ever longer."""
        last, wait = self._logged_at.get((group, message), (float('-inf'), 0.0))
        if now - last < wait:
            return False
        if len(self._logged_at) > MOST_STATES:
            self._logged_at.clear()
        again = now - last < FORGOTTEN * wait
        self._logged_at[group, message] = (
            now, min(2.0 * wait, LONGEST) if again else REPEATED
        )  # fmt: skip
        return True


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
