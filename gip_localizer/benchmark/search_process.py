# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The suites `track`, `acquire` and `global`, in a separate process.

OpenCV decides when it is loaded whether it uses IPP. Therefore `gip bench` runs this module with
and without IPP, and takes the faster time as that of OpenCV. It prints one JSON object.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
import json
import math
import sys
import time
from typing import Any, TypeVar

import cv2
import numpy as np

from gip_localizer.benchmark.opencv_baseline import baseline_winner, baseline_work
from gip_localizer.benchmark.rows import interleaved, median
from gip_localizer.benchmark.scene import ACQUIRE, known_map, Scene, TRACK, Window
from gip_localizer.core.match.lattice import make_canvas, map_window, widened
from gip_localizer.core.match.pyramid import coarse_to_fine as pyramid
from gip_localizer.core.match.pyramid.level import Level
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import Birdseye

Out = TypeVar('Out')

GLOBAL_SIDE = 100.0
"""Side of the whole map, metres; chosen."""
GLOBAL_YAWS = 360
"""Number of headings of the whole-map search: one per degree."""
NOISES = (16.0, 48.0, 80.0)
"""Factors (no unit) on the noise in the comparison of the two searches; chosen."""
WINDOWS = {'track': TRACK, 'acquire': ACQUIRE}
Result = dict[str, Any]


def score_all(level: Level) -> pyramid.Winner:
    """Score every candidate with the paper's norm, as the baseline does."""
    return pyramid.exhaustive_winner(level, normalized=False, min_overlap=0.5)


def coarse_to_fine(level: Level) -> pyramid.Winner:
    """Search coarse to fine with the same norm."""
    return pyramid.pyramid_winner(level, normalized=False, min_overlap=0.5)


SEARCHES = {'exhaustive': score_all, 'coarse to fine': coarse_to_fine}


def timed(work: Callable[[], Out]) -> tuple[float, Out]:
    """Return the duration of a call (ms) and its result."""
    start = time.perf_counter()
    out = work()
    return 1e3 * (time.perf_counter() - start), out


def window_suite(scene: Scene, window: Window, frames: int, judged: int, seed: int) -> Result:
    """Time all searches frame by frame; on the first frames compare the results as well."""
    rng = np.random.default_rng([1, seed])
    times: dict[str, list[float]] = {'exhaustive': [], 'coarse to fine': [], 'peer': []}
    same = {'exhaustive': 0, 'coarse to fine': 0, 'both': 0}
    for k in range(frames):
        level, _ = scene.level(rng, window)
        yaws = len(level.lattice.yaws)
        times['peer'].append(timed(baseline_work(level, yaws))[0])
        found = {}
        for name, search in SEARCHES.items():
            spent, winner = timed(partial(search, level))
            times[name].append(spent)
            found[name] = winner.index
        same['both'] += found['exhaustive'] == found['coarse to fine']
        if k < judged:
            expected = baseline_winner(level)
            for name, index in found.items():
                same[name] += index == expected
    return {'times': times, 'same': same, 'frames': frames, 'judged': min(judged, frames)}


def count_noise_misses(scene: Scene, frames: int) -> list[Result]:
    """Count the frames on which each search misses the truth at low SNR."""
    counts = []
    for noise in NOISES:
        rng = np.random.default_rng(2)
        wrong = dict.fromkeys(SEARCHES, 0)
        times: dict[str, list[float]] = {name: [] for name in SEARCHES}
        same = 0
        for _ in range(frames):
            level, truth = scene.level(rng, TRACK, noise=noise)
            found = []
            for name, search in SEARCHES.items():
                spent, winner = timed(partial(search, level))
                times[name].append(spent)
                found.append(winner.index)
                wrong[name] += bool((np.abs(np.array(winner.index) - truth) > 2.0).any())
            same += found[0] == found[1]
        counts.append({
            'noise': noise, 'frames': frames, 'missed': wrong, 'same': same,
            'ms': {name: median(spent) for name, spent in times.items()},
        })
    return counts


def global_level(scene: Scene, rng: np.random.Generator) -> Level:
    """Return the search of a square map at every heading, for a frame on this map."""
    raster_map = known_map(scene, GLOBAL_SIDE)
    width = GLOBAL_SIDE
    step = 2.0 * math.pi / GLOBAL_YAWS
    anchor = Pose2(0.5 * width - scene.pivot, 0.5 * width, 0.0)
    lattice = replace(
        scene.lattice(anchor, Window(0.0, 0.0, 0.0, step)),
        yaws=(np.arange(GLOBAL_YAWS) - GLOBAL_YAWS // 2) * step,
    )
    canvas = make_canvas(scene.grid, lattice)
    cells = round(width / scene.grid.resolution)
    half = (cells - max(canvas.rows, canvas.cols)) // 2
    lattice = replace(lattice, half=(half, half))
    index = np.array([rng.uniform(1.0, n - 2.0) for n in lattice.shape])
    values = scene.view(lattice.pose(index), rng)
    window, known = map_window(raster_map, widened(canvas, lattice), anchor)
    return Level(
        scene.grid, values, scene.weight, lattice, canvas, window * known, known
    )


def global_suite(scene: Scene, frames: int, exhaustive: int, seed: int) -> Result:
    """Time the search of a whole map; the baseline on a few yaws, full scoring on few frames."""
    rng = np.random.default_rng([3, seed])
    times: dict[str, list[float]] = {'exhaustive': [], 'coarse to fine': [], 'peer': []}
    same = 0
    for k in range(frames):
        level = global_level(scene, rng)
        spent, quick = timed(partial(coarse_to_fine, level))
        times['coarse to fine'].append(spent)
        if k < exhaustive:
            times['peer'].append(timed(baseline_work(level, 4))[0] * GLOBAL_YAWS / 4)
            spent, best = timed(partial(score_all, level))
            times['exhaustive'].append(spent)
            same += quick.index == best.index
    return {'times': times, 'same': {'both': same}, 'frames': frames, 'judged': exhaustive}


def growth_suite(scene: Scene) -> list[Result]:
    """Return median times as functions of window, number of yaws and cells of the view."""
    points: list[Result] = []

    def take(axis: str, size: float, measured: Scene, window: Window) -> None:
        level, _ = measured.level(np.random.default_rng(4), window)
        yaws = len(level.lattice.yaws)
        work: dict[str, Callable[[], object]] = {
            name: partial(search, level) for name, search in SEARCHES.items()
        }
        work['peer'] = baseline_work(level, min(yaws, 3))
        for name, times in interleaved(work, 5).items():
            found = median(times) * (yaws / min(yaws, 3) if name == 'peer' else 1.0)
            points.append({'axis': axis, 'size': size, 'search': name, 'ms': found})

    for half in (0.25, 0.5, 1.0, 2.0, 4.0):
        take('window half-width [m]', half, scene, replace(TRACK, x=half, y=half))
    for count in (2, 5, 15, 45):
        take('yaws', 2 * count + 1, scene, replace(TRACK, yaw=count * TRACK.yaw_step))
    for resolution in (0.2, 0.1, 0.05):
        smaller = Scene(60.0, Birdseye(2.5, 12.5, 4.0, resolution))
        take('cells of the view', smaller.grid.rows * smaller.grid.cols, smaller, TRACK)
    return points


def main(arguments: list[str]) -> int:
    """Run a suite and print the results; arguments: `suite frames judged seed`."""
    suite, (frames, judged, seed) = arguments[0], map(int, arguments[1:])
    scene = Scene(140.0)
    found: Result = {'ipp': bool(getattr(cv2, 'ipp', None)) and bool(cv2.ipp.useIPP())}
    if suite in WINDOWS:
        found |= window_suite(scene, WINDOWS[suite], frames, judged, seed)
    elif suite == 'noise':
        found['noise'] = count_noise_misses(scene, frames)
    elif suite == 'growth':
        found['growth'] = growth_suite(scene)
    else:
        found |= global_suite(scene, frames, judged, seed)
    sys.stdout.write(json.dumps(found))
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
