# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""How often states that come and go are logged, in hours that pass in a moment."""

from __future__ import annotations

import pytest

pytest.importorskip('rclpy')

from ros_support import Tester

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters.integration import Diagnostics
from gip_localizer.ros.localizer.diagnostics import DiagnosticsPublisher
from gip_localizer.session.diagnostics import HealthMonitor

pytestmark = pytest.mark.ros
S = 1_000_000_000
GOOD = Estimate(S, Status.TRACKING, 'well', Pose2(0.0, 0.0, 0.0))
DARK = Estimate(S, Status.LOW_CONTRAST, 'contrast 0.0000 is below integrity.min_contrast 0.002')


@pytest.fixture
def tester():
    node = Tester()
    yield node
    node.close()


class Clock:
    now = 100.0

    def __call__(self):
        return self.now


def test_a_state_that_recurs_is_logged_ever_more_rarely_and_as_new_after_an_hour(tester, capfd):
    clock = Clock()
    health = HealthMonitor(Diagnostics(camera_timeout=3600.0, odometry_timeout=3600.0),
                           steady=clock)
    health.update_inputs({}, {'camera_info': 1, 'odom': 1})
    health.on_odometry()
    diagnostics = DiagnosticsPublisher(tester, health)

    def lines(seconds, estimates):
        """Lines about the match while estimates take turns, one every five seconds."""
        capfd.readouterr()
        for turn in range(seconds // 5):
            clock.now += 5.0
            stamp = round(clock.now * S)
            health.on_image(stamp, stamp)
            health.frame_finished(estimates[turn % len(estimates)], 5.0)
            diagnostics.publish()
        output = capfd.readouterr()
        return (output.out + output.err).count('match: ')

    assert lines(60, [GOOD, DARK]) == 4  # each twice: at once, and after 30 s
    assert lines(540, [GOOD, DARK]) <= 8
    assert lines(3600, [GOOD, DARK]) <= 14
    # It stays dark: at most one line, and none while nothing changes.
    assert lines(1800, [DARK]) <= 1
    assert lines(1800, [DARK]) == 0
    # A new state, and one that was long forgotten, are logged at once.
    assert lines(10, [GOOD]) == 1
    assert lines(10, [DARK]) == 1
