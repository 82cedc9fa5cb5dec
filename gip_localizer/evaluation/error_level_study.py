# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Consistency of the covariances for several settings of the error level.

Run by `make error-level`; its worlds are used by no reported number. Each frame is matched once,
and its covariance computed with each of the settings.

"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace
import sys

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.refine.error_level import ErrorLevel, LevelSettings
from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.development import development_matches, SEEDS, SETUPS
from gip_localizer.evaluation.error_table import ELLIPSE_95
from gip_localizer.evaluation.suites.conditions import Setup

DEFAULT = LevelSettings()
OPTIONS = {
    'default': DEFAULT,
    'not learned': replace(DEFAULT, most_learned=0.0),
    'rarity 1.0': replace(DEFAULT, rarity=1.0),
    'rarity 1.6': replace(DEFAULT, rarity=1.6),
    'memory 20': replace(DEFAULT, memory=20.0),
    'learned 0.98, half at 2': replace(DEFAULT, most_learned=0.98, half_learned=2.0),
    'spread 0.1': replace(DEFAULT, spread=0.1),
}

Judged = tuple[Floats, list[Floats]]
"""Error (3,) of a published match, and its covariance with each of `OPTIONS`."""


def main() -> int:
    """Print a table: mean NEES and share inside the 95 % ellipse by cause and option."""
    argparse.ArgumentParser(
        prog='make error-level',
        description='Print the consistency of the covariances for settings of the error level, '
                    'on development worlds. It takes ten minutes on one core.',
    ).parse_args()
    use_one_thread()
    _write('', list(OPTIONS))
    for setup in SETUPS:
        levels = {name: ErrorLevel(settings=option) for name, option in OPTIONS.items()}
        found = [judged for seed in SEEDS for judged in _frames(setup, seed, levels)]
        _write(setup.name, [
            _consistency([(error, spreads[k]) for error, spreads in found])
            for k in range(len(OPTIONS))
        ])
    return 0


def _write(name: str, cells: list[str]) -> None:
    sys.stdout.write(f'{name:12s}' + ''.join(f'{cell:>26s}' for cell in cells) + '\n')
    sys.stdout.flush()


def _frames(setup: Setup, seed: int, levels: dict[str, ErrorLevel]) -> Iterator[Judged]:
    """Match the frames of one world; `levels` learns from each."""
    for error, fit in development_matches(setup, seed):
        shared = {name: fit.find_shared(level) for name, level in levels.items()}
        levels.update({name: found.level for name, found in shared.items()})
        yield error, [fit.own_covariance + found.covariance for found in shared.values()]


def _consistency(judged: list[tuple[Floats, Floats]]) -> str:
    if not judged:
        return '-'
    nees = [e @ np.linalg.solve(c, e) for e, c in judged]
    xy = [e[:2] @ np.linalg.solve(c[:2, :2], e[:2]) for e, c in judged]
    inside = np.mean(np.array(xy) <= ELLIPSE_95)
    return f'{np.mean(nees):.2f} {inside:.0%}'


if __name__ == '__main__':
    sys.exit(main())
