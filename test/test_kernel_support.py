# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The parts that yaws are divided into: all yaws, and all that the turned weight touches."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.match.fft import cost
from gip_localizer.core.match.fft_regions import make_parts
from gip_localizer.core.match.lattice import make_canvas, make_lattice
from gip_localizer.core.match.template_rotation import Templates, turn_affine
from gip_localizer.core.pose import Pose2

GRID = Grid(7.0, 2.5, 60, 50, 0.1)
PIVOT = 3.0


def wedge() -> np.ndarray:
    """A view with empty near corners."""
    across = np.abs(np.arange(GRID.cols) - 24.5)
    return (across[None] < np.linspace(30.0, 8.0, GRID.rows)[:, None]).astype(np.float32)


@pytest.mark.parametrize('half_yaw', [0.05, 0.3, 3.0])
@pytest.mark.parametrize('translations', [(5, 5), (61, 41)])
def test_parts_hold_every_yaw_and_every_cell_with_weight(half_yaw, translations):
    weight = wedge()
    lattice = make_lattice(Pose2(0.0, 0.0, 0.0), x=0.2, y=0.2, yaw=half_yaw, yaw_step=0.01,
                           step=0.1, pivot=PIVOT)
    canvas = make_canvas(GRID, lattice)
    affines = [turn_affine(GRID, canvas, float(yaw), PIVOT) for yaw in lattice.yaws]
    parts = make_parts(weight, affines, canvas.shape, translations, 2, cost)
    assert [k for part in parts for k in part.yaws] == list(range(len(affines)))
    turned, templates = np.empty(canvas.shape, np.float32), Templates(1, weight.shape)
    templates.planes[0] = weight
    for part in parts:
        assert part.shape[0] <= canvas.rows
        assert part.shape[1] <= canvas.cols
        for yaw in part.yaws:
            templates.turn_into(turned[None], affines[yaw])
            assert turned[part.rows, part.cols].sum() == pytest.approx(turned.sum(), rel=1e-6)


def test_a_view_without_weight_needs_next_to_nothing():
    affine = turn_affine(GRID, GRID, 0.0, PIVOT)
    (part,) = make_parts(np.zeros(GRID.shape, np.float32), [affine], GRID.shape, (5, 5), 2, cost)
    assert part.shape == (1, 1)
