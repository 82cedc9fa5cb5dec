# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The covariance that comes from errors that are smooth over the view, and their level."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.pose import Pose2
from gip_localizer.core.refine.error_level import ErrorLevel
from gip_localizer.core.refine.smooth_errors import BlockSums, SmoothErrors

UNKNOWNS = 5
HERE = Pose2(0.0, 0.0, 0.0)


def sums(rng, centres, bend):
    """Return blocks that see independent errors of 1 mm and a bend of the map (m)."""
    x, y = centres.T
    information = 1e6
    levers = np.zeros((len(x), 2, UNKNOWNS))
    levers[:, 0, 0] = levers[:, 1, 1] = 1.0
    levers[:, 0, 2], levers[:, 1, 2] = -y, x
    field = np.stack([bend * np.sin(x), bend * np.cos(0.7 * x + y)], axis=1)
    seen = field + rng.normal(0.0, 1e-3, field.shape)
    parts = information * np.einsum('bik,bil->bkl', levers, levers)
    pulls = information * np.einsum('bik,bi->bk', levers, seen)
    whole = parts.sum(axis=0) + 1e-3 * np.eye(UNKNOWNS)
    step = np.linalg.solve(whole, pulls.sum(axis=0))
    pulls = pulls - parts @ step
    return BlockSums(parts, pulls, whole, np.zeros(UNKNOWNS)), step[:3]


def view():
    x, y = np.meshgrid(np.arange(3.0, 13.0), np.arange(-3.5, 4.0))
    centres = np.stack([x.ravel(), y.ravel()], axis=1)
    return centres, SmoothErrors(centres, np.array([0.0, 0.0, 1.5]))


def covariance(errors, matched, level=None):
    return errors.shared(matched, level or ErrorLevel(), HERE).covariance


def learned(errors, matches):
    """Return the level after matches that are 10 m min_distance."""
    level = ErrorLevel()
    for index, matched in enumerate(matches):
        level = errors.shared(matched, level, Pose2(10.0 * index, 0.0, 0.0)).level
    return level


def test_it_vanishes_where_blocks_err_alone():
    rng = np.random.default_rng(3)
    centres, errors = view()
    estimated = [np.diag(covariance(errors, sums(rng, centres, 0.0)[0])) for _ in range(20)]
    own = 1e-6 * np.diag(np.linalg.inv(sums(rng, centres, 0.0)[0].total[:3, :3] * 1e-6))
    assert np.all(np.mean(estimated, axis=0) < 1.0 * own)


def test_a_bent_map_is_seen():
    rng = np.random.default_rng(4)
    centres, errors = view()
    bent, error = sums(rng, centres, 0.03)
    spread = covariance(errors, bent)
    assert np.linalg.eigvalsh(spread).min() > 0.0
    assert error @ np.linalg.solve(spread, error) < 11.3  # chi-square, 3 degrees, 99 %
    assert np.sqrt(np.trace(spread[:2, :2])) > 2e-3


def seen_near(matched, centres):
    """Return a match whose pattern lies within 1 m, where it cannot show that the map is bent."""
    share = np.where(np.hypot(centres[:, 0] - 4.0, centres[:, 1]) < 0.8, 1.0, 1e-6)
    parts = matched.matrices * share[:, None, None]
    whole = parts.sum(axis=0) + 1e-3 * np.eye(UNKNOWNS)
    pulls = matched.gradients * share[:, None]
    pulls -= parts @ np.linalg.solve(whole, pulls.sum(axis=0))
    return BlockSums(parts, pulls, whole, matched.prior)


def test_a_frame_that_shows_no_bend_is_not_believed_on_a_bent_map():
    rng = np.random.default_rng(5)
    centres, errors = view()
    bent = learned(errors, [sums(rng, centres, 0.03)[0] for _ in range(8)])
    flat = learned(errors, [sums(rng, centres, 0.0)[0] for _ in range(8)])
    frame = seen_near(sums(rng, centres, 0.0)[0], centres)
    warned, calm = (np.trace(covariance(errors, frame, level)) for level in (bent, flat))
    assert warned > 10.0 * calm


def test_frames_without_errors_let_the_next_one_be_believed():
    rng = np.random.default_rng(6)
    centres, errors = view()
    level = learned(errors, [sums(rng, centres, 0.0)[0] for _ in range(8)])
    next_one = sums(rng, centres, 0.0)[0]
    assert np.trace(covariance(errors, next_one, level)) < 1.5 * np.trace(
        covariance(errors, next_one)
    )


def test_a_vehicle_that_waits_learns_nothing_new():
    rng = np.random.default_rng(7)
    centres, errors = view()
    level = errors.shared(sums(rng, centres, 0.03)[0], ErrorLevel(), HERE).level
    near = Pose2(0.5, 0.0, 0.0)
    assert errors.shared(sums(rng, centres, 0.0)[0], level, near).level is level
    assert errors.shared(sums(rng, centres, 0.0)[0], level, Pose2(9.0, 0.0, 0.0)).level.frames == 2
