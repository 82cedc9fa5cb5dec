# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The metrics of a run: errors, consistency of covariances, availability, speed.

A metric that cannot be computed (no ground truth, no published pose) is None, never zero. The
definitions agree with evo's absolute pose error without alignment.

"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gip_localizer.evaluation.camera_motion import corrections, mean_camera_motion
from gip_localizer.evaluation.error_table import ELLIPSE_95, ErrorTable, tabulate_errors
from gip_localizer.evaluation.protection_metrics import protection_metrics
from gip_localizer.evaluation.run import FrameResult, Run

Floats = NDArray[np.float64]
Metrics = dict[str, Any]


class TableRow(NamedTuple):
    """A row of the table of metrics."""

    name: str
    value: str
    unit: str


def compute_metrics(run: Run) -> Metrics:
    """
    Return all metrics of a run, ready for JSON.

    Parameters
    ----------
    run : Run
        Estimates, truth and configuration.

    Returns
    -------
    dict
        The keys of `metrics.json`: counts, errors in metres and degrees, NEES, latencies in
        milliseconds, means of the camera's motion and what they correct, `config`. Unknown
        metrics are None.

    """
    table = tabulate_errors(run.estimates, run.truth, run.wrong)
    return {
        'complete': run.complete,
        **_counts(table, run.estimates),
        **_errors(table),
        **_consistency(table),
        'protection': protection_metrics(run.estimates, table),
        'camera_motion': mean_camera_motion(run.estimates),
        'corrections': corrections(run.estimates, run.parameters),
        **_speed(run),
        'config': {
            **run.sources, 'wrong_xy_m': run.wrong.xy_m, 'wrong_yaw_deg': run.wrong.yaw_deg,
            'parameters': run.parameters.to_dict(),
        },
    }


def _counts(table: ErrorTable, estimates: Sequence[FrameResult]) -> Metrics:
    frames, published = len(table.published), int(table.published.sum())
    first_fix: float | None = None
    if published:
        fix = table.stamps_ns[np.argmax(table.published)]
        first_fix = float(fix - table.stamps_ns[0]) * 1e-9
    words = Counter(status_word(estimate) for estimate in estimates)
    return {
        'frames': frames,
        'published': published,
        'rejected': frames - published,
        'availability': published / frames if frames else None,
        'time_to_first_fix_s': first_fix,
        'statuses': dict(sorted(words.items())),
    }


def status_word(estimate: FrameResult) -> str:
    """Return the status as a string."""
    return str(getattr(estimate.status, 'value', estimate.status))


def _errors(table: ErrorTable) -> Metrics:
    judged = table.judged
    xy, body = table.xy[judged], table.body[judged]
    yaw_deg = np.degrees(body[:, 2])
    truth_known = bool(np.isfinite(table.truth).all(1).any())
    return {
        'judged': int(judged.sum()) if truth_known else None,
        'rmse_xy_m': _rms(xy),
        'rmse_lateral_m': _rms(body[:, 1]),
        'rmse_longitudinal_m': _rms(body[:, 0]),
        'rmse_yaw_deg': _rms(yaw_deg),
        'median_xy_m': _percentile(xy, 50.0),
        'p95_xy_m': _percentile(xy, 95.0),
        'max_xy_m': _percentile(xy, 100.0),
        'median_yaw_deg': _percentile(np.abs(yaw_deg), 50.0),
        'p95_yaw_deg': _percentile(np.abs(yaw_deg), 95.0),
        'max_yaw_deg': _percentile(np.abs(yaw_deg), 100.0),
        'wrong_published': int(table.wrong.sum()) if truth_known else None,
    }


def _consistency(table: ErrorTable) -> Metrics:
    nees, inside = _finite(table.nees), _finite(table.nees_xy) <= ELLIPSE_95
    sigma = table.sigma[table.published]
    return {
        'nees_mean': float(nees.mean()) if len(nees) else None,
        'coverage_95': float(inside.mean()) if len(inside) else None,
        'median_sigma_longitudinal_m': _percentile(_finite(sigma[:, 0]), 50.0),
        'median_sigma_lateral_m': _percentile(_finite(sigma[:, 1]), 50.0),
        'median_sigma_yaw_deg': _percentile(np.degrees(_finite(sigma[:, 2])), 50.0),
    }


def _speed(run: Run) -> Metrics:
    stages: dict[str, list[float]] = {}
    for estimate in run.estimates:
        for stage, value in estimate.timings_ms.items():
            stages.setdefault(stage, []).append(value)
    seconds = run.wall_seconds
    by_stage = {stage: _spread(np.array(values)) for stage, values in stages.items()
                if stage != 'total'}
    return {
        'latency_ms': {**_spread(latencies_ms(run.estimates)), 'stages': by_stage},
        'frames_per_second': len(run.estimates) / seconds if seconds else None,
    }


def latencies_ms(estimates: Sequence[FrameResult]) -> Floats:
    """Return the latency of each frame with timings, ms."""
    known = [latency_ms(estimate) for estimate in estimates]
    return np.array([value for value in known if value is not None], np.float64)


def latency_ms(estimate: FrameResult) -> float | None:
    """Return `total` of the timings of a frame, or the sum of its stages, ms; None: untimed."""
    timings = estimate.timings_ms
    if not timings:
        return None
    return timings['total'] if 'total' in timings else sum(timings.values())


def _spread(values: Floats) -> dict[str, float | None]:
    return {f'p{q}': _percentile(values, float(q)) for q in (50, 95, 99)}


def _finite(values: Floats) -> Floats:
    return values[np.isfinite(values)]


def _rms(values: Floats) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if len(values) else None


def _percentile(values: Floats, percent: float) -> float | None:
    return float(np.percentile(values, percent)) if len(values) else None


OPTIONAL = ('protection.', 'camera_motion.')
"""Groups of metrics that need the localizer's figures: who has messages alone lacks them."""
TABLE = (
    ('frames', 'frames', '', 1.0, '.0f'),
    ('published', 'published', '', 1.0, '.0f'),
    ('availability', 'availability', '%', 100.0, '.1f'),
    ('time_to_first_fix_s', 'time to first fix', 's', 1.0, '.2f'),
    ('rmse_xy_m', 'position error, rms', 'mm', 1e3, '.1f'),
    ('rmse_longitudinal_m', 'longitudinal error, rms', 'mm', 1e3, '.1f'),
    ('rmse_lateral_m', 'lateral error, rms', 'mm', 1e3, '.1f'),
    ('rmse_yaw_deg', 'yaw error, rms', 'deg', 1.0, '.3f'),
    ('median_xy_m', 'position error, median', 'mm', 1e3, '.1f'),
    ('p95_xy_m', 'position error, 95th percentile', 'mm', 1e3, '.1f'),
    ('max_xy_m', 'position error, largest', 'mm', 1e3, '.1f'),
    ('wrong_published', 'wrong poses published', '', 1.0, '.0f'),
    ('protection.misleading', 'errors above the protection level', '', 1.0, '.0f'),
    ('protection.median_ahead_m', 'protection level ahead, median', 'mm', 1e3, '.1f'),
    ('protection.median_left_m', 'protection level left, median', 'mm', 1e3, '.1f'),
    ('nees_mean', 'NEES, mean: error² over covariance (consistent: 3)', '', 1.0, '.2f'),
    ('coverage_95', 'truth inside the 95 % ellipse', '%', 100.0, '.1f'),
    ('camera_motion.pitch_deg', 'pitch from calibration, mean', 'deg', 1.0, '+.3f'),
    ('camera_motion.roll_deg', 'roll from calibration, mean', 'deg', 1.0, '+.3f'),
    ('camera_motion.height_m', 'height from calibration, mean', 'mm', 1e3, '+.1f'),
    ('camera_motion.gain', 'gain of the image, mean', '', 1.0, '.3f'),
    ('latency_ms.p50', 'latency, median', 'ms', 1.0, '.1f'),
    ('latency_ms.p95', 'latency, 95th percentile', 'ms', 1.0, '.1f'),
    ('latency_ms.p99', 'latency, 99th percentile', 'ms', 1.0, '.1f'),
    ('frames_per_second', 'frames per second', '1/s', 1.0, '.1f'),
)


def look_up(metrics: Mapping[str, Any], dotted: str) -> Any:
    """Return a metric by its dotted name; None if it is missing."""
    value: Any = metrics
    for part in dotted.split('.'):
        value = value.get(part) if isinstance(value, Mapping) else None
    return value


def table_rows(metrics: Mapping[str, Any]) -> list[TableRow]:
    """Return the rows metric, value, unit; unknown metrics of `OPTIONAL` groups are left out."""
    rows = []
    for key, name, unit, scale, form in TABLE:
        value = look_up(metrics, key)
        if value is None and key.startswith(OPTIONAL):
            continue
        text = 'unknown' if value is None else format(value * scale, form)
        if key == 'wrong_published':
            name += _bounds_in_words(metrics)
        rows.append(TableRow(name, text, unit if value is not None else ''))
    return rows


def _bounds_in_words(metrics: Mapping[str, Any]) -> str:
    xy, yaw = (look_up(metrics, f'config.wrong_{name}') for name in ('xy_m', 'yaw_deg'))
    return f' (error above {xy:g} m or {yaw:g} deg)' if xy is not None and yaw is not None else ''


def format_table(rows: Sequence[TableRow]) -> str:
    """Return the rows as aligned text with a header line."""
    lines = [TableRow('metric', 'value', 'unit'), *rows]
    wide = [max(len(line[column]) for line in lines) for column in range(3)]
    return '\n'.join(
        f'{line.name:<{wide[0]}}  {line.value:>{wide[1]}}  {line.unit}'.rstrip() for line in lines
    )
