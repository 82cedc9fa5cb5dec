# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of the poses of a mapped drive, estimated from frames that see the same road."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from gip_localizer.core.map.accuracy import MapAccuracy
from gip_localizer.core.pose import Pose2
from gip_localizer.mapping.pose_errors import estimate_pose_errors, Pair
from gip_localizer.mapping.pose_pairs import choose_pairs, driven_distances, Station

LENGTH = 10.0  # m, of the view
CELL = 0.05  # m, of the map
MEASURED = np.diag([1e-3, 1e-3, 1e-4]) ** 2


def stations(count: int = 200, step: float = 0.5, radius: float = np.inf) -> list[Station]:
    """A straight drive, or rounds on a circle."""
    way = step * np.arange(count)
    if np.isinf(radius):
        return [Station(int(1e8 * k), Pose2(float(s), 0.0, 0.0)) for k, s in enumerate(way)]
    return [Station(int(1e8 * k), Pose2(radius * np.sin(s / radius), -radius * np.cos(s / radius),
                                        s / radius)) for k, s in enumerate(way)]


def pairs(accuracy: MapAccuracy, seed: int, smooth: float = 8.0) -> list[Pair]:
    """Pairs of a drive whose pose errors are smooth over some metres, with measurement noise."""
    rng, frames = np.random.default_rng(seed), stations()
    driven = driven_distances(frames)
    apart = np.subtract.outer(driven, driven)
    root = np.linalg.cholesky(np.exp(-0.5 * (apart / smooth) ** 2) + 1e-9 * np.eye(len(driven)))
    error = root @ rng.normal(size=(len(driven), 3)) * np.array(
        [accuracy.sigma_xy, accuracy.sigma_xy, accuracy.sigma_yaw]
    )
    made = []
    for i, j in choose_pairs(frames, LENGTH):
        one, other = (Pose2(*(np.array(frames[k].pose) + error[k])) for k in (i, j))
        seen = one @ one.inverse() @ other @ frames[j].pose.inverse() @ frames[i].pose
        noise = rng.multivariate_normal(np.zeros(3), MEASURED)
        made.append(Pair(
            stamps_ns=(frames[i].stamp_ns, frames[j].stamp_ns),
            driven=(float(driven[i]), float(driven[j])),
            lever=(frames[i].pose.x - frames[j].pose.x, frames[i].pose.y - frames[j].pose.y),
            disagreement=np.array(seen) - np.array(one) + noise, covariance=MEASURED,
        ))
    return made


@pytest.mark.parametrize('accuracy', [
    MapAccuracy(0.005, 0.001), MapAccuracy(0.02, 0.002), MapAccuracy(0.1, 0.005),
])
def test_the_errors_of_smooth_poses_are_estimated(accuracy):
    found = np.array([estimate_pose_errors(pairs(accuracy, seed), CELL).accuracy
                      for seed in range(2)])
    ratio = np.sqrt(np.mean(found**2, axis=0)) / np.array(accuracy)
    assert np.all((ratio > 0.5) & (ratio < 2.0)), ratio


def test_exact_poses_have_errors_of_the_size_of_the_measurements():
    accuracy = estimate_pose_errors(pairs(MapAccuracy(), seed=1), CELL).accuracy
    assert accuracy.sigma_xy < 0.003
    assert accuracy.sigma_yaw < 3e-4


def test_a_pose_that_jumped_is_named_and_changes_nothing_else():
    good = pairs(MapAccuracy(0.005, 0.001), seed=2)
    bad = good[7]
    jumped = replace(bad, disagreement=bad.disagreement + np.array([0.4, -0.2, 0.0]))
    found = estimate_pose_errors([*good[:7], jumped, *good[8:]], CELL)
    assert [pair.stamps_ns for pair in found.outliers] == [bad.stamps_ns]
    without = estimate_pose_errors([*good[:7], *good[8:]], CELL)
    assert found.accuracy == pytest.approx(without.accuracy)


def test_a_camera_that_is_mounted_otherwise_is_no_error_of_the_poses():
    made = pairs(MapAccuracy(0.005, 0.001), seed=2)
    scaled = [replace(pair, disagreement=pair.disagreement + 0.04 * np.array([*pair.lever, 0.0]))
              for pair in made]
    one, other = (estimate_pose_errors(some, CELL) for some in (made, scaled))
    assert other.accuracy == pytest.approx(one.accuracy, rel=0.02)
    assert other.drift - one.drift == pytest.approx([-0.04, 0.0], abs=1e-3)
    assert abs(other.drift[0] + 0.04) < 3.0 * other.drift_sigma < 0.01


def test_pairs_are_of_frames_that_see_the_same_road():
    frames = stations()
    driven = driven_distances(frames)
    chosen = choose_pairs(frames, LENGTH)
    assert len(chosen) > 20
    assert all(0.0 < driven[j] - driven[i] < LENGTH for i, j in chosen)


def test_a_second_pass_is_compared_with_the_first():
    frames = stations(count=280, step=0.5, radius=15.0)  # one and a half rounds
    driven = driven_distances(frames)
    revisits = [(i, j) for i, j in choose_pairs(frames, LENGTH)
                if driven[j] - driven[i] > 4.0 * LENGTH]
    assert revisits
    assert all(frames[i].pose.distance(frames[j].pose) < LENGTH / 3.0 for i, j in revisits)


@pytest.mark.parametrize('count', [0, 1])
def test_fewer_than_two_frames_make_no_pair(count):
    assert choose_pairs(stations(count), LENGTH) == []
