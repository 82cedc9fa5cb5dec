# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Prediction, comparison and fusion of beliefs: the equations of the pose filter."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.belief import Belief
from gip_localizer.core.pose import Pose2, wrap_angle

# Largest squared Mahalanobis distance (no unit) of two poses that agree: the 99.99 % quantile of
# the chi-square distribution with 3 degrees of freedom (x, y, yaw).
GATE_SQ = 21.1


def agree(innovation: Floats, total: Floats) -> bool:
    """
    Return whether two poses differ by no more than their covariances allow.

    Parameters
    ----------
    innovation : (3,) array
        Difference of the poses in x, y (m) and yaw (rad).
    total : (3, 3) array
        Sum of their covariances.

    """
    return bool(innovation @ np.linalg.solve(total, innovation) < GATE_SQ)


def excess_share(length: float, limit: float) -> float:
    """Return the share of a length that exceeds a limit of the same unit."""
    return max(1.0 - limit / length, 0.0) if length > 0.0 else 0.0


def scaled_motion(motion: Pose2, factor: float) -> Pose2:
    """Return a motion at a constant velocity that takes `factor` times as long."""
    return Pose2(motion.x * factor, motion.y * factor, motion.yaw * factor)


def moved(belief: Belief, stamp_ns: int, motion: Pose2, motion_covariance: Floats) -> Belief:
    """Return a belief after a motion and its covariance (3, 3), both in base axes at the start."""
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

    The gain is that for independent errors. Errors that both beliefs share stay in the covariance
    in full (Schmidt 1966), because averaging does not reduce them.

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
