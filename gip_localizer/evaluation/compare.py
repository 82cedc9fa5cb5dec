# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Compare results folders: metrics, differing parameters, and errors in one chart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import json
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullFormatter
import numpy as np
from numpy.typing import NDArray

from gip_localizer.errors import GipError
from gip_localizer.evaluation.metrics import look_up, Metrics, TABLE
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.io.tum_files import read_tum

Floats = NDArray[np.float64]
UNKNOWN = 'unknown'


class ResultsError(GipError):
    """A results folder cannot be read."""


@dataclass(frozen=True)
class RunFolder:
    """
    The content of a results folder.

    Attributes
    ----------
    label : str
        Shortest name that distinguishes it from the other folders.
    metrics : dict
        Content of `metrics.json`.
    seconds, errors_m : (n,) float64
        Time since the first pose of the ground truth, and position error, of the published frames
        with known truth.

    """

    label: str
    metrics: Metrics
    seconds: Floats
    errors_m: Floats


def read_runs(folders: Sequence[Path]) -> list[RunFolder]:
    """
    Read results folders.

    Raises
    ------
    ResultsError
        A folder has no readable `metrics.json`, or the file lacks the metrics.
    TrajectoryError
        A trajectory in a folder is malformed.

    """
    return [_read(folder, label) for folder, label in zip(folders, _labels(folders), strict=True)]


def _labels(folders: Sequence[Path]) -> list[str]:
    """Return the fewest trailing parts of the paths that make the labels unique."""
    parts = [folder.absolute().parts for folder in folders]
    for depth in range(1, max(map(len, parts)) + 1):
        labels = ['/'.join(part[-depth:]) for part in parts]
        if len(set(labels)) == len(labels):
            return labels
    return [f'{number}: {folder}' for number, folder in enumerate(folders, start=1)]


def _read(folder: Path, label: str) -> RunFolder:
    path = folder / 'metrics.json'
    try:
        metrics = json.loads(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ResultsError(
            f'{path}: {error.strerror}; expected a folder that gip replay or gip demo wrote'
        ) from None
    except ValueError as error:
        raise ResultsError(f'{path}: is no JSON ({error})') from None
    _check(path, metrics)
    return RunFolder(label, metrics, *_errors(folder))


def _check(path: Path, metrics: Any) -> None:
    if not isinstance(metrics, dict) or metrics.get('frames') is None:
        raise ResultsError(f'{path}: holds no metrics of a run; expected the key "frames"')
    for key, *_ in TABLE:
        value = look_up(metrics, key)
        if not isinstance(value, (int, float, type(None))):
            raise ResultsError(f'{path}: {key} is {value!r:.80}; expected a number or null')


def _errors(folder: Path) -> tuple[Floats, Floats]:
    truth_file, estimate_file = folder / 'ground_truth.tum', folder / 'estimate.tum'
    if not truth_file.is_file() or not estimate_file.is_file() or not estimate_file.stat().st_size:
        return np.empty(0), np.empty(0)
    truth, estimate = read_tum(truth_file), read_tum(estimate_file)
    return _distances(truth, estimate)


def _distances(truth: Trajectory, estimate: Trajectory) -> tuple[Floats, Floats]:
    apart = estimate.poses - truth.at(estimate.stamps_ns)
    errors = np.hypot(apart[:, 0], apart[:, 1])
    known = np.isfinite(errors)
    seconds = (estimate.stamps_ns - truth.stamps_ns[0]) * 1e-9
    return seconds[known], errors[known]


def metric_lines(runs: Sequence[RunFolder]) -> list[list[str]]:
    """Return one line per metric: name and unit, then the value of each run."""
    lines = []
    for key, name, unit, scale, form in TABLE:
        values = [look_up(run.metrics, key) for run in runs]
        texts = [UNKNOWN if value is None else format(value * scale, form) for value in values]
        lines.append([f'{name} [{unit}]' if unit else name, *texts])
    complete = ['yes' if run.metrics.get('complete', True) else 'no' for run in runs]
    return [['complete', *complete], *lines]


def parameter_lines(runs: Sequence[RunFolder]) -> list[list[str]]:
    """Return one line per parameter or input source that differs between the runs."""
    flat = [_flat(run.metrics.get('config', {})) for run in runs]
    names = dict.fromkeys(name for config in flat for name in config)
    lines = [[name, *(config.get(name, '-') for config in flat)] for name in names]
    return [line for line in lines if len(set(line[1:])) > 1]


def _flat(config: Any) -> dict[str, str]:
    if not isinstance(config, dict):
        return {}
    parameters = config.get('parameters')
    flat = {str(k): str(v) for k, v in config.items() if k != 'parameters'}
    if not isinstance(parameters, dict):
        return flat
    return flat | {str(k): str(v) for k, v in parameters.items()}


def comparison_figure(runs: Sequence[RunFolder]) -> Figure:
    """Draw the position error over time and its distribution for all runs."""
    figure = Figure(figsize=(5.2, 6.4))
    over_time, spread = figure.subplots(2, 1)
    for run in runs:
        if len(run.errors_m) == 0:
            continue
        error_mm = np.maximum(run.errors_m * 1e3, 1e-3)
        over_time.plot(run.seconds, error_mm, lw=1.0, label=run.label)
        ranked = np.sort(error_mm)
        share = np.arange(1, len(ranked) + 1) / max(int(run.metrics['frames']), len(ranked))
        spread.step(ranked, 100.0 * share, where='post', label=run.label)
    over_time.set(yscale='log', xlabel='time [s]', ylabel='position error [mm]')
    spread.set(xscale='log', ylim=(0.0, 101.0), xlabel='position error [mm]',
               ylabel='frames with at most this error [%]')
    for axis in (over_time.yaxis, spread.xaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FormatStrFormatter('%g'))
        axis.set_minor_formatter(NullFormatter())
    if any(len(run.errors_m) for run in runs):
        over_time.legend(loc='lower left', bbox_to_anchor=(0.0, 1.0), ncols=2, fontsize=8)
    return figure
