# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `conditions`: errors, consistency and availability of single frames, by condition."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np
from scipy.stats import chi2

from gip_localizer.evaluation.suites.conditions import Condition, CONDITIONS
from gip_localizer.evaluation.suites.suite import (
    Bound,
    Cell,
    of_part,
    ratio,
    Record,
    Section,
    share,
)
from gip_localizer.evaluation.suites.trials import Bench, Spread, Trial

FREEDOM = 3
"""Degrees of freedom of the NEES: x, y and yaw."""
MOST_NEES = 6.0
"""Largest mean NEES (no unit) where the model does not hold: twice the expected value; chosen."""
LEAST_JUDGED = 20
"""Number of published poses from which their mean NEES is compared with its band: of fewer, one
frame in the tail of the law moves the mean out of it; chosen."""
MOST_SIGMA_RATIO = 3.0
"""Largest ratio (no unit) of reported sigma to root mean square error; chosen."""


@dataclass(frozen=True)
class Summary:
    """Metrics of a condition; NaN where no pose was published."""

    frames: int
    published: int
    wrong: int
    rmse_xy: float
    rmse_yaw: float
    largest_xy: float
    nees: float
    sigma_xy: float
    sigma_yaw: float
    raw_rmse_xy: float


def summary(trials: Sequence[Trial]) -> Summary:
    """Return the metrics of the trials of a condition."""
    shown = [t for t in trials if t.error is not None and t.covariance is not None]
    raw = np.array([t.raw_error for t in trials if t.raw_error is not None]).reshape(-1, 3)
    errors = np.array([t.error for t in shown]).reshape(-1, 3)
    variances = np.array([np.diag(t.covariance) for t in shown]).reshape(-1, 3)  # type: ignore[arg-type]
    distance = np.hypot(errors[:, 0], errors[:, 1])
    return Summary(
        frames=len(trials), published=len(shown), wrong=sum(t.wrong for t in shown),
        rmse_xy=_rms(distance), rmse_yaw=_rms(errors[:, 2]),
        largest_xy=float(distance.max()) if len(shown) else math.nan,
        nees=float(np.mean([t.nees for t in shown])) if shown else math.nan,
        sigma_xy=_rms(np.sqrt(variances[:, 0] + variances[:, 1])),
        sigma_yaw=_rms(np.sqrt(variances[:, 2])),
        raw_rmse_xy=_rms(np.hypot(raw[:, 0], raw[:, 1])),
    )


def _rms(values: np.ndarray) -> float:  # type: ignore[type-arg]
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan


def nees_band(count: int) -> tuple[float, float]:
    """Return the 95 % band of the mean NEES of `count` frames, 3 degrees of freedom."""
    if count == 0:
        return math.nan, math.nan
    low, high = chi2.ppf([0.025, 0.975], FREEDOM * count) / count
    return float(low), float(high)


def condition_bounds(condition: Condition, found: Summary) -> list[Bound]:
    """Return the bounds of a condition."""
    low, high = nees_band(found.published)
    if not condition.model_holds:
        low, high = 0.0, MOST_NEES
    row = condition.name
    demands = [
        Bound(row, 'rmse of the position [mm]', 1e3 * found.rmse_xy, 1e3 * condition.rmse_xy_m),
        Bound(row, 'rmse of the yaw [deg]', math.degrees(found.rmse_yaw),
              condition.rmse_yaw_deg),
        Bound(row, 'wrong poses published', found.wrong, 0),
        Bound(row, 'sigma over rmse, position', ratio(found.sigma_xy, found.rmse_xy),
              MOST_SIGMA_RATIO),
        Bound(row, 'sigma over rmse, yaw', ratio(found.sigma_yaw, found.rmse_yaw),
              MOST_SIGMA_RATIO),
    ]
    if found.published >= LEAST_JUDGED:
        demands.append(Bound(row, 'mean NEES', found.nees, high))
        if condition.model_holds:
            demands.append(Bound(row, 'mean NEES', found.nees, low, at_most=False))
    return demands


class SingleFrame:
    """Single frames without filter, with starts within ±0.5 m and ±3°."""

    name = 'conditions'
    title = 'Single frames without filter, starts within 0.5 m and 3 degrees'
    columns = (
        'condition', 'frames', 'published', 'rmse [mm]', 'bound', 'largest [mm]', 'yaw [deg]',
        'bound', 'wrong', 'NEES', 'band', 'sigma/rmse', 'all-match rmse [mm]',
    )

    @property
    def setups(self) -> Mapping[str, Condition]:
        """Conditions by name."""
        return {condition.name: condition for condition in CONDITIONS}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per condition."""
        return frames

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame."""
        return [Record(self.name, part, index, '', bench.trial(index, Spread()))]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return one row per condition."""
        rows: list[Sequence[Cell]] = []
        demands: list[Bound] = []
        for condition in CONDITIONS:
            found = summary([r.trial for r in of_part(records, condition.name)])
            rows.append(_row(condition, found))
            demands += condition_bounds(condition, found)
        return Section(self.name, self.title, self.columns, rows, demands, (
            'NEES: mean normalised squared error of the published poses, 3 degrees of freedom. If '
            'the covariances are true, it lies in the band with a probability of 95 %. '
            f'It is a bound from {LEAST_JUDGED} published poses on.',
            'All-match rmse: of every match, including the withheld ones.',
        ))


def _row(condition: Condition, found: Summary) -> list[Cell]:
    low, high = nees_band(found.published)
    band = f'{low:.2f}..{high:.2f}' if condition.model_holds else f'..{MOST_NEES:g}'
    return [
        condition.name, found.frames, f'{share(found.published, found.frames):.1%}',
        round(1e3 * found.rmse_xy, 2), f'{1e3 * condition.rmse_xy_m:g}',
        round(1e3 * found.largest_xy, 1), round(math.degrees(found.rmse_yaw), 4),
        f'{condition.rmse_yaw_deg:g}', found.wrong, round(found.nees, 2), band,
        round(ratio(found.sigma_xy, found.rmse_xy), 2), round(1e3 * found.raw_rmse_xy, 2),
    ]
