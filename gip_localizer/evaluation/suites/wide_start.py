# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Suite `cmrnet`: one frame, start errors up to 3.5 m and 17 degrees, as in CMRNet's protocol.

The norms score the same view on the same lattice, so that only their weights differ. ORB matches
features. `localizer` is the complete pipeline with its refinement. A trial succeeds if the error
is within 0.5 m and 2 degrees.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
import math
import weakref

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.pixel_noise import estimate_pixel_noise
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.gramian import gramian
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.search.local_search import lattice_scores
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.evaluation.suites.conditions import CAR_CAMERA, CARS, CHANGED, NIGHT, Setup
from gip_localizer.evaluation.suites.suite import Bound, Cell, of_part, Record, Section, share
from gip_localizer.evaluation.suites.trials import Bench, compared, is_wrong, ORIGIN, Spread, Trial
from gip_localizer.paper.baselines import BaselineInput, orb_homography
from gip_localizer.parameters import Birdseye
from gip_localizer.parameters.spec import Value

START = Spread(3.5, 3.5, math.radians(17.0))
"""Largest offsets of starts (m, m, rad): those of CMRNet's protocol."""
WINDOW: dict[str, Value] = {
    'search.x': 3.6, 'search.y': 3.6, 'search.yaw': math.radians(18.0), 'search.yaw_step': 0.0175,
}
"""Search window that holds all starts, in the units of its parameters."""
NOISY = Setup(
    name='dark', title='dark and noisy: mean grey about 10', scenario='night',
    camera={**CAR_CAMERA, 'sensor.gain': 0.08, 'sensor.full_well': 500.0,
            'sensor.read_noise': 0.02},
)
SETUPS = tuple(
    replace(setup, localizer={**setup.localizer, **WINDOW})
    for setup in (NIGHT, CARS, CHANGED, NOISY)
)
NORMS = {  # method: (weights, gain and offset profiled out)
    'gip': ('gramian', False),
    'gip_normalized': ('gramian', True),
    'euclidean': ('equal', False),
    'euclidean_normalized': ('equal', True),
    'distance decay': ('decay', True),
}
ORB, OURS = 'ORB + homography', 'localizer'
METHODS = (OURS, *NORMS, ORB)
DECAY = 1e-3
"""Decay of the weights with the squared distance, 1/m²: that of YabLoc."""
ORB_CELL_M = 0.02
"""Cell size of the view for ORB, metres; chosen."""
SHARE_OF_FRAMES = 5
"""Divisor of `--frames`: a wide search takes about as long as five narrow ones; chosen."""


class WideStart:
    """Success rates of single frames from starts within ±3.5 m and ±17°."""

    name = 'cmrnet'
    title = 'Success rate of one frame from start errors up to 3.5 m and 17 degrees'
    columns = ('condition', 'frames', *METHODS)

    @property
    def setups(self) -> Mapping[str, Setup]:
        """Setups by name."""
        return {setup.name: setup for setup in SETUPS}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per setup."""
        return max(frames // SHARE_OF_FRAMES, 1)

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame with every method."""
        rng = bench.rng(index)
        frame = bench.frame(rng)
        start = frame.truth @ START.offset(rng)
        ours = compared(bench.localize(frame.image, start, START.covariance), frame.truth)
        poses = _by_norms(bench, frame.image, start)
        poses[ORB] = _by_orb(bench, frame.image, start)
        trials = {name: _trial(pose, frame.truth) for name, pose in poses.items()}
        return [Record(self.name, part, index, name, trial)
                for name, trial in {OURS: ours, **trials}.items()]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return the success rates by condition and method."""
        rows: list[Sequence[Cell]] = [_row(s.name, of_part(records, s.name)) for s in SETUPS]
        rows.append(_row('ALL', records))
        ours, total = _successes(records, OURS)
        demands = [
            Bound('all', f'success of {name} minus that of the localizer',
                  share(_successes(records, name)[0] - ours, total), 0.0)
            for name in (*NORMS, ORB)
        ]
        return Section(self.name, self.title, self.columns, rows, demands, (
            'Success: the error of the best match, published or not, is within 0.5 m and '
            '2 degrees.',
            'gip, gip_normalized, euclidean, euclidean_normalized and distance decay '
            '(weights exp(-0.001 d²), normalized) on the same view and lattice, cells of 0.1 m.',
        ))


def _successes(records: Sequence[Record], method: str) -> tuple[int, int]:
    chosen = [r.trial for r in records if r.kind == method]
    return sum(t.raw_error is not None and not is_wrong(t.raw_error) for t in chosen), len(chosen)


def _row(name: str, records: Sequence[Record]) -> list[Cell]:
    counts = [_successes(records, method) for method in METHODS]
    return [name, counts[0][1], *(f'{share(*count):.1%}' for count in counts)]


def _trial(pose: Pose2 | None, truth: Pose2) -> Trial:
    if pose is None:
        return Trial('NONE')
    return Trial('FOUND', raw_error=difference(truth.inverse() @ pose, ORIGIN))


_rectifiers: weakref.WeakKeyDictionary[Bench, dict[float, Rectifier]] = (
    weakref.WeakKeyDictionary()
)


def rectifier(bench: Bench, cell: float) -> Rectifier:
    """Return the rectifier of a bench for a cell size in metres; it is made once."""
    made = _rectifiers.setdefault(bench, {})
    if cell not in made:
        view = bench.parameters.birdseye
        made[cell] = Rectifier(
            bench.drive.camera, Birdseye(view.near, view.far, view.half_width, cell)
        )
    return made[cell]


def _by_norms(bench: Bench, image: np.ndarray, start: Pose2) -> dict[str, Pose2 | None]:  # type: ignore[type-arg]
    view = rectifier(bench, bench.parameters.birdseye.resolution).rectify(image)
    search, score = bench.parameters.search, bench.parameters.score
    extent = SearchWindow(search.x, search.y, search.yaw, search.yaw_step, score.min_overlap)
    weights = _weights(view, estimate_pixel_noise(image), score.map_noise)
    found: dict[str, Pose2 | None] = {}
    for name, (weight, normalized) in NORMS.items():
        scores = lattice_scores(
            view, weights[weight], MapCrops(bench.raster_map), start, extent, normalized=normalized
        )
        known = np.isfinite(scores.residual).any()
        found[name] = scores.lattice.pose(np.array(scores.best(), float)) if known else None
    return found


def _weights(view: View, pixel_noise: float, map_noise: float) -> dict[str, Floats]:
    """Return three weights: the Gramian, equal weights, and weights that decay with distance."""
    equal = view.valid.astype(np.float32)
    distance_sq = (view.grid.points() ** 2).sum(axis=1).reshape(view.grid.shape)
    return {
        'gramian': gramian(view.footprint, pixel_noise=pixel_noise, map_noise=map_noise),
        'equal': equal,
        'decay': (equal * np.exp(-DECAY * distance_sq)).astype(np.float32),
    }


def _by_orb(bench: Bench, image: np.ndarray, start: Pose2) -> Pose2 | None:  # type: ignore[type-arg]
    search = bench.parameters.search
    view = rectifier(bench, ORB_CELL_M).rectify(image)
    yaws = np.linspace(-search.yaw, search.yaw, 3)
    found = orb_homography(BaselineInput(view, bench.raster_map, start, search.x, yaws))
    return None if found is None else start @ found
