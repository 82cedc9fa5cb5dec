# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Modes of the whole window of a level, scored in blocks of yaws that bound the memory."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gip_localizer.core.match.peaks import Mode, modes_of, ResidualLookup
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.match.score_surface import score_yaws
from gip_localizer.core.match.scoring import Residuals, Scorer

# Number of candidates that are examined per mode that is kept (design choice: 4, because
# neighbours of a mode are among the best candidates too).
CANDIDATES_PER_MODE = 4
# Number of candidates of the largest cells that are scored at once (design choice: 16,000,000,
# which are 64 MB of float32).
BLOCK_CANDIDATES = 16_000_000
# Least number of yaws of a block (design choice: 12, because two more are scored per block to
# compare its first and last yaw with their neighbours).
MIN_YAWS = 12


def best_of_window(
    level: Level, normalized: bool, min_overlap: float, count: int, within: float
) -> tuple[list[Mode], float]:
    """Return the modes of the whole window, best first, and the depth of the best one."""
    scorer = make_scorer(level, normalized, min_overlap)
    found: list[Mode] = []
    depths: list[float] = []
    for yaws, own in _blocks(level.lattice.shape):
        modes, depth = _best_of_block(level, scorer, yaws, count, within)
        found += [mode for mode in modes if own.start - 0.5 <= mode[1][0] < own.stop - 0.5]
        depths.append(depth)
    return sorted(found)[:count], max(depths)


def _blocks(shape: tuple[int, int, int]) -> list[tuple[slice, range]]:
    """Divide yaws into blocks; return the yaws to be scored and those of the block itself."""
    count = shape[0]
    size = max(BLOCK_CANDIDATES // (shape[1] * shape[2]), MIN_YAWS)
    return [
        (slice(max(first - 1, 0), min(first + size + 1, count)),
         range(first, min(first + size, count)))
        for first in range(0, count, size)
    ]


def _best_of_block(
    level: Level, scorer: Scorer, yaws: slice, count: int, within: float
) -> tuple[list[Mode], float]:
    """Return the modes of some yaws, best first, and the depth of the best one."""
    lattice = replace(level.lattice, yaws=level.lattice.yaws[yaws])
    residual = np.empty(lattice.shape, np.float32)

    def keep(part: slice, found: Residuals) -> None:
        residual[part] = found.residual

    score_yaws(scorer, level.grid, level.canvas, lattice, keep)
    flat = residual.ravel()
    examined, middle = min(CANDIDATES_PER_MODE * count, flat.size), flat.size // 2
    order = np.argpartition(flat, examined - 1)[:examined]
    least, usual = float(flat[order].min()), float(np.partition(flat, middle)[middle])
    if not np.isfinite(least):
        return [], 0.0
    depth = usual - least if np.isfinite(usual) else np.inf
    order = order[flat[order] <= least + within * depth]
    order = order[np.lexsort((order, flat[order]))]
    places = np.stack(np.unravel_index(order, residual.shape), axis=1)
    modes = modes_of(places, ResidualLookup(residual), count)
    return [(value, (peak[0] + yaws.start, *peak[1:])) for value, peak in modes], depth


def make_scorer(level: Level, normalized: bool, min_overlap: float) -> Scorer:
    """Return a scorer of the residuals of a level."""
    return Scorer(
        level.values, level.weight, level.window, level.known,
        normalized=normalized, min_overlap=min_overlap, residual_only=True,
        everywhere=level.everywhere,
    )
