# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The covariance that comes from errors that are smooth over the view."""

from __future__ import annotations

import numpy as np

from gip_localizer.core.refine.smooth_errors import BlockSums, SmoothErrors

UNKNOWNS = 5


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


def test_it_vanishes_where_blocks_err_alone():
    rng = np.random.default_rng(3)
    centres, errors = view()
    told = [np.diag(errors.covariance(sums(rng, centres, 0.0)[0])) for _ in range(20)]
    own = 1e-6 * np.diag(np.linalg.inv(sums(rng, centres, 0.0)[0].whole[:3, :3] * 1e-6))
    assert np.all(np.mean(told, axis=0) < 1.0 * own)


def test_a_bent_map_is_seen():
    rng = np.random.default_rng(4)
    centres, errors = view()
    bent, error = sums(rng, centres, 0.03)
    covariance = errors.covariance(bent)
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert error @ np.linalg.solve(covariance, error) < 11.3  # chi-square, 3 degrees, 99 %
    assert np.sqrt(np.trace(covariance[:2, :2])) > 2e-3
