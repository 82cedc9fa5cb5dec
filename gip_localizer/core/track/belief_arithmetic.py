# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Beliefs that are moved, compared and fused: the arithmetic of the pose filter."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2, wrap_angle

GATE_SQ = 21.1  # chi-square, 3 degrees of freedom, 99.99 %


def agree(innovation: Floats, total: Floats) -> bool:
    """Whether two poses differ by no more than their covariances allow."""
    return bool(innovation @ np.linalg.solve(total, innovation) < GATE_SQ)


def beyond(length: float, reach: float) -> float:
    """Share of a length that lies beyond a reach."""
    return max(1.0 - reach / length, 0.0) if length > 0.0 else 0.0


def scaled(motion: Pose2, factor: float) -> Pose2:
    """Return a motion at a constant velocity that takes `factor` times as long."""
    return Pose2(motion.x * factor, motion.y * factor, motion.yaw * factor)


def moved(belief: Belief, stamp_ns: int, motion: Pose2, motion_covariance: Floats) -> Belief:
    """Return a belief after a motion (base axes) of a covariance (3, 3)."""
    pose = belief.pose @ motion
    shift = np.eye(3)
    shift[0, 2], shift[1, 2] = -(pose.y - belief.pose.y), pose.x - belief.pose.x
    turn = np.eye(3)
    turn[:2, :2] = belief.pose.rotation()
    covariance = shift @ belief.covariance @ shift.T + turn @ motion_covariance @ turn.T
    return Belief(stamp_ns, pose, covariance, shared=shift @ belief.shared)


def fused(prior: Belief, measured: Belief, innovation: Floats, total: Floats) -> Belief:
    """
    Return the Kalman update of a prior; `innovation` (3,) has the covariance `total` (3, 3).

    The gain is that of independent errors; the covariance counts what both share in full
    (Schmidt 1966), so that it does not average away.

    """
    gain = np.linalg.solve(total, prior.covariance).T
    step = gain @ innovation
    keep = np.eye(3) - gain
    covariance = keep @ prior.covariance @ keep.T + gain @ measured.covariance @ gain.T
    crossed = keep @ prior.shared @ measured.shared.T @ gain.T
    covariance += crossed + crossed.T
    pose = Pose2(
        prior.pose.x + float(step[0]), prior.pose.y + float(step[1]),
        wrap_angle(prior.pose.yaw + float(step[2])),
    )
    return Belief(
        measured.stamp_ns, pose, 0.5 * (covariance + covariance.T),
        shared=keep @ prior.shared + gain @ measured.shared,
    )
