# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Which frames a report shows and why, and what the demo knows of its frames."""

from __future__ import annotations

import numpy as np
from run_samples import circle, EPOCH, STEP

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.demo import ReceivedMessages
from gip_localizer.evaluation.worst_frames import WorstFrames

MAP = RasterMap(np.zeros((4, 4), np.uint8), 1.0, Pose2(0.0, 0.0, 0.0))
TRUTH = circle(20)


def tracked(number, error=0.0, sigma=0.01):
    x, y, yaw = TRUTH.poses[number]
    pose = Pose2(float(x) + error, float(y), float(yaw))
    return Estimate(EPOCH + STEP * number, Status.TRACKING, '', pose, np.eye(3) * sigma**2)


def withheld(number, status):
    return Estimate(EPOCH + STEP * number, status, 'for a reason')


def shown(estimates, truth=TRUTH):
    worst = WorstFrames(truth, MAP)
    for estimate in estimates:
        worst.add(lambda: np.zeros((3, 4), np.uint8), estimate)
    return worst.exhibits()


def test_the_largest_errors_then_nees_then_each_status_are_shown_with_the_reason():
    frames = [tracked(n, error=0.001 * n) for n in range(10)]
    frames[2] = tracked(2, error=0.002, sigma=0.0001)  # small error, absurd covariance
    frames += [withheld(10, Status.NO_MATCH), withheld(11, Status.NO_MATCH),
               withheld(12, Status.LOST)]
    exhibits = shown(frames)
    assert [exhibit.title.split(',')[0] for exhibit in exhibits] == [
        'Frame 10', 'Frame 9', 'Frame 8', 'Frame 3', 'Frame 7', 'Frame 11', 'Frame 13']
    assert 'error 9.0 mm' in exhibits[0].title
    assert [exhibit.why for exhibit in exhibits[:4]] == [
        'Rank 1 of 10 published frames by position error.',
        'Rank 2 of 10 published frames by position error.',
        'Rank 3 of 10 published frames by position error.',
        'Rank 1 of 10 published frames by NEES.']
    assert exhibits[5].why == 'First of 2 frames with NO_MATCH.'
    assert exhibits[6].why == 'The only frame with LOST.'
    assert 'NO_MATCH, for a reason' in exhibits[5].title


def test_without_truth_the_least_certain_frames_are_shown():
    exhibits = shown([tracked(n, sigma=0.001 * (n + 1)) for n in range(6)], truth=None)
    assert [exhibit.title.split(',')[0] for exhibit in exhibits] == [
        'Frame 6', 'Frame 5', 'Frame 4']
    assert 'by reported standard deviation' in exhibits[0].why


def test_a_demo_has_the_statuses_of_a_replay():
    received = ReceivedMessages(truth={n: Pose2(float(n), 0.0, 0.0) for n in range(3)})
    received.poses[0] = (Pose2(0.3, 0.4, 0.0), np.eye(3), 20.0)
    received.diagnostics.append((1, 'WITHHELD: NO_MATCH: confidence 0.1'))
    frames = received.frames()
    assert [frame.status for frame in frames] == ['TRACKING', 'NO_MATCH', 'NO_POSE']
    assert frames[1].reason == 'confidence 0.1'
    assert 'arrived' in frames[2].reason
    assert received.error_m(0) == received.newest_error_m() == 0.5
    assert received.error_m(1) is None
