# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Trials whose figures the confidence is fitted to.

Every part of the suites on worlds of its own, whose seeds no reported number uses; each frame is
localized from a right start and from wrong ones.

"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
import csv
from dataclasses import dataclass, replace
import math
from pathlib import Path

from gip_localizer.core.estimate import Estimate
from gip_localizer.evaluation.suites.conditions import (
    CARS,
    CHANGED,
    CLEAR,
    NIGHT,
    PITCH,
    Setup,
    SHADOWS,
)
from gip_localizer.evaluation.suites.integrity import (
    GROUPS,
    POOR,
    POOR_NOISY,
    RIGHT,
    wrong_start,
)
from gip_localizer.evaluation.suites.model_error import CAUSES
from gip_localizer.evaluation.suites.trials import Bench, compared, is_wrong, Spread
from gip_localizer.evaluation.suites.wide_start import NOISY
from gip_localizer.parameters.spec import Value

WORLDS = (5_100_002, 5_100_003)
"""Seeds of the worlds; chosen: no suite, test or document uses them."""
MORE_WORLDS = (5_100_004, 5_100_005)
"""Seeds of further worlds of the hard parts alone; chosen in the same way."""
FRAMES = 2
"""Number of frames of each part in each world; chosen: the trials take 15 minutes."""
STARTS = (RIGHT, 'outside the window', 'another street', 'beside the road')
KEPT = Path(__file__).with_name('trials.csv')
"""The figures of the trials, from which the fit can be made again in seconds."""
FIGURES = (
    'margin', 'significance', 'agreement', 'overdispersion', 'sigma_cells', 'suspension',
)
"""What of each match is recorded: the candidates for the fit."""
SMALL_CAMERA: dict[str, Value] = {'lens.width': 640, 'lens.height': 360, 'lens.focal': 450.0}
SMALL_VIEW: dict[str, Value] = {'birdseye.resolution': 0.1}
FLAT_CAMERA: dict[str, Value] = {'camera.z': 1.65, 'camera.pitch': math.radians(1.0)}
FLAT_VIEW: dict[str, Value] = {'birdseye.near': 6.0, 'birdseye.far': 15.0}
EQUAL = tuple(
    replace(setup, name=f'repeated, {setup.name}', ground='repeated')
    for setup in (NIGHT, CARS, CHANGED, SHADOWS, replace(CLEAR, name='noisy map', map_noise=0.05))
)
"""Repeated ground whose equal places differ by what the map does not show."""
HARD = ('cars', 'tiles', 'relaid', 'glare', 'nadir', 'together')
OWN_CAMERA = ('tiles', 'nadir')
"""Parts whose camera stays as it is; all others get a small one, at a third of the time."""

@dataclass(frozen=True)
class ConfidenceTrial:
    """
    Result of one start.

    Attributes
    ----------
    part, start : str
        Names of the setup and of the kind of start.
    world : int
        Seed of the world.
    right : bool
        The best match, published or not, is within 0.5 m and 2 degrees of the truth.
    figures : dict
        Of the match, by name.

    """

    part: str
    world: int
    start: str
    right: bool
    figures: dict[str, float]


def trial_jobs() -> list[tuple[int, Setup]]:
    """Return what is tried: worlds and setups."""
    hard, easy = _hard(), _easy()
    return [(world, setup) for world in WORLDS for setup in (*easy, *hard)] + [
        (world, setup) for world in MORE_WORLDS for setup in hard
    ]


def _hard() -> tuple[Setup, ...]:
    """Return the setups in which wrong matches come near to right ones, or the reverse."""
    of_suite = [setup for group in GROUPS.values() for setup in group]
    hard = [s for s in of_suite if s.ground != 'as made' or s.map_noise or s.name in HARD]
    hard += [_cause(cause) for cause in CAUSES if cause.name in HARD]
    return tuple(map(_small, (*hard, SHADOWS, NOISY, _far(POOR[0]), _far(SHADOWS))))


def _easy() -> tuple[Setup, ...]:
    of_suite = [setup for group in GROUPS.values() for setup in group]
    causes = [_cause(cause) for cause in CAUSES if cause.name != SHADOWS.name]
    setups = [*of_suite, PITCH, *causes, *EQUAL, _far(CLEAR), _far(CHANGED)]
    hard = {setup.name for setup in _hard()}
    easy = [setup for setup in map(_small, setups) if setup.name not in hard]
    return (*easy, POOR_NOISY, CARS)


def _cause(cause: Setup) -> Setup:
    return replace(cause, name=f'error: {cause.name}')


def _small(setup: Setup) -> Setup:
    """Return a setup with a quarter of the pixels and of the cells."""
    if any(name in setup.name for name in OWN_CAMERA):
        return setup
    return replace(
        setup, name=f'{setup.name}, small camera', camera={**setup.camera, **SMALL_CAMERA},
        localizer={**setup.localizer, **SMALL_VIEW},
    )


def _far(setup: Setup) -> Setup:
    """Return a setup whose camera looks to the horizon."""
    return replace(
        setup, name=f'far, {setup.name}', camera={**setup.camera, **FLAT_CAMERA},
        localizer={**setup.localizer, **FLAT_VIEW},
    )


def make_trials(setup: Setup, world: int) -> Iterator[ConfidenceTrial]:
    """Yield the trials of a part in a world that found a match, right or wrong."""
    bench = Bench(setup, world, {})
    for index in range(FRAMES):
        rng = bench.rng(index)
        frame = bench.frame(rng)
        truth = bench.truth(frame)
        for kind in STARTS:
            start = wrong_start(kind, truth, bench, rng)
            estimate = bench.localize(frame.image, start, Spread().covariance)
            tried = compared(estimate, truth)
            if tried.raw_error is not None and _is_judged(estimate):
                figures = {name: tried.quality[name] for name in FIGURES}
                right = not is_wrong(tried.raw_error)
                yield ConfidenceTrial(setup.name, world, kind, right, figures)


def _is_judged(estimate: Estimate) -> bool:
    """Whether the confidence decides: all other reasons to withhold a match come first."""
    match = estimate.match
    return match is not None and match.fit is not None and match.fit.converged


def write(path: Path, trials: Sequence[ConfidenceTrial]) -> None:
    """Write trials as CSV, figures to four digits."""
    with path.open('w', newline='') as file:
        rows = csv.writer(file, lineterminator='\n')
        rows.writerow(['part', 'world', 'start', 'right', *FIGURES])
        for trial in trials:
            figures = [f'{trial.figures[name]:.4g}' for name in FIGURES]
            rows.writerow([trial.part, trial.world, trial.start, int(trial.right), *figures])


def read(path: Path) -> list[ConfidenceTrial]:
    """Read the trials that `write` wrote."""
    with path.open(newline='') as file:
        return [
            ConfidenceTrial(row['part'], int(row['world']), row['start'], row['right'] == '1',
                  {name: float(row[name]) for name in FIGURES})
            for row in csv.DictReader(file)
        ]
