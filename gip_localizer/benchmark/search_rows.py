# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The rows of the search suites: OpenCV runs with and without IPP, and the faster counts."""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import Any

from gip_localizer.benchmark.children import child
from gip_localizer.benchmark.opencv_baseline import NAME
from gip_localizer.benchmark.rows import compared_row, median, Row, spread

MODULE = 'gip_localizer.benchmark.search_process'
IPP = {'IPP on': {}, 'IPP off': {'OPENCV_IPP': 'disabled'}}
"""Environment of each state; both are equal for an OpenCV without IPP."""
CASES = {
    'track': '200x160 cells, ±0.5 m, 11 yaws over ±2.5°',
    'acquire': '200x160 cells, ±5 m, 61 yaws over ±15°',
    'global': '200x160 cells, 100x100 m at 5 cm, 360 yaws',
}
Details = dict[str, Any]


def search_suite(suite: str, frames: int, judged: int, rounds: int) -> tuple[list[Row], Details]:
    """
    Return a row for scoring all candidates and one for the coarse-to-fine search.

    Parameters
    ----------
    suite : str
        track, acquire or global.
    frames, judged : int
        Number of frames, and of those that the slow search processes too.
    rounds : int
        Number of runs with each state of IPP, each on different frames.

    """
    found: dict[str, list[Details]] = {state: [] for state in IPP}
    part = [str(max(math.ceil(n / rounds), 1)) for n in (frames, judged)]
    for seed in range(rounds):
        for state, environment in IPP.items():
            found[state].append(child(MODULE, [suite, *part, str(seed)], environment))
    times = {state: _joined(parts) for state, parts in found.items()}
    peer = min(times, key=lambda state: median(times[state]['peer']))
    ours = times['IPP on']
    rows = [
        compared_row(suite, f'{CASES[suite]}: {search}, engine alone',
               median(ours[search]), f'{NAME}, {peer}', median(times[peer]['peer']),
               _same(suite, search, found['IPP on']))
        for search in ('exhaustive', 'coarse to fine')
    ]
    return rows, {
        'times_ms': {state: {name: {'median': median(t), 'spread': spread(t)}
                             for name, t in each.items()} for state, each in times.items()},
        'winners': [{k: v for k, v in p.items() if k != 'times'} for p in found['IPP on']],
    }


def _joined(parts: list[Details]) -> dict[str, list[float]]:
    names = parts[0]['times']
    return {name: [t for part in parts for t in part['times'][name]] for name in names}


def _same(suite: str, search: str, parts: list[Details]) -> float | None:
    """
    Return the fraction of frames with the same best candidate.

    Scoring all candidates is compared with OpenCV, and the coarse-to-fine search with scoring all:
    on a whole map OpenCV would take minutes per frame.

    """
    if search == 'exhaustive':
        if suite == 'global':
            return None
        return _share(parts, 'exhaustive', 'judged')
    return _share(parts, 'both', 'judged' if suite == 'global' else 'frames')


def _share(parts: list[Details], name: str, of: str) -> float | None:
    total = sum(part[of] for part in parts)
    return sum(part['same'][name] for part in parts) / total if total else None


def noise_suite(frames: int) -> tuple[list[Row], list[Details]]:
    """Return how often each search misses the truth at low SNR, with 95 % intervals."""
    counts: list[Details] = child(MODULE, ['noise', str(frames), '0', '0'], {})['noise']
    for count in counts:
        count['missed_95_percent'] = {
            search: wilson(missed, count['frames']) for search, missed in count['missed'].items()
        }
    return [_noise_row(count) for count in counts], counts


def _noise_row(count: Details) -> Row:
    missed = count['missed']
    return compared_row(
        'noise', f'track, {count["noise"]:g} times the noise: coarse to fine misses '
        f'{missed["coarse to fine"]} of {count["frames"]}, exhaustive {missed["exhaustive"]}',
        count['ms']['coarse to fine'], 'exhaustive', count['ms']['exhaustive'],
        count['same'] / count['frames'],
    )


def wilson(hits: int, trials: int, z: float = 1.96) -> tuple[float, float]:
    """Return Wilson's interval of a fraction."""
    share, extra = hits / trials, z * z / trials
    middle = (share + 0.5 * extra) / (1.0 + extra)
    width = z * math.sqrt(share * (1.0 - share) / trials + 0.25 * extra / trials) / (1.0 + extra)
    return max(middle - width, 0.0), min(middle + width, 1.0)


def growth_details() -> list[Mapping[str, Any]]:
    """Return times as functions of window, yaws and cells."""
    points: list[Mapping[str, Any]] = child(MODULE, ['growth', '0', '0', '0'], {})['growth']
    return points
