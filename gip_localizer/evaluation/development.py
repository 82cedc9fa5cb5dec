# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Matches on which constants are fitted: their worlds are used by no reported number."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from gip_localizer.core.arrays import Floats
from gip_localizer.core.refine.fit import Fit
from gip_localizer.evaluation.suites.conditions import CONDITIONS, Setup
from gip_localizer.evaluation.suites.model_error import CAUSES
from gip_localizer.evaluation.suites.trials import Bench, compared, Spread
from gip_localizer.parameters.spec import Value

SEEDS = range(7101, 7107)
"""Seeds of the worlds; chosen: no reported number uses them."""
FRAMES = 4
"""Number of frames of each world; chosen: all setups then take ten minutes."""
SETUPS: tuple[Setup, ...] = (*CAUSES, *CONDITIONS)


def development_matches(
    setup: Setup, seed: int, overrides: Mapping[str, Value] | None = None
) -> Iterator[tuple[Floats, Fit]]:
    """
    Yield the published matches of a world.

    Parameters
    ----------
    setup : Setup
        What is rendered and how it is localized.
    seed : int
        Of the world, one of `SEEDS`.
    overrides : dict or None
        Changes of the localizer's parameters.

    Yields
    ------
    (3,) float64, Fit
        Error ahead, left (m), yaw (rad), and the match.

    """
    bench = Bench(setup, seed, overrides or {})
    for index in range(FRAMES):
        image, truth, start = bench.scene(index, Spread())
        estimate = bench.localize(image, start, Spread().covariance)
        error = compared(estimate, truth).error
        if error is not None and estimate.match is not None and estimate.match.fit is not None:
            yield error, estimate.match.fit
