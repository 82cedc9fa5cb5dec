# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Test of the protection level: misleading information, and the Stanford diagram."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure
import numpy as np
from scipy.stats import beta, binom

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.core.protection import protection_level
from gip_localizer.evaluation.suites.suite import Bound
from gip_localizer.evaluation.suites.trials import Trial
from gip_localizer.visualization.style import ESTIMATE, WRONG

RISKS = (1e-3, 1e-4, 1e-5)
"""Risks of the protection levels, probability per frame; chosen."""
AXES = (('ahead', 'mm', 1e3), ('left', 'mm', 1e3), ('heading', 'deg', float(np.degrees(1.0))))
"""Name, unit and factor to it of each component."""
SURE = 0.95
"""Probability (no unit) that a bound on counted events holds; chosen."""
EXACT = np.zeros((3, 3))
"""Covariance from the mounting yaw of the camera, which is exact in the suites by definition."""
SIZE = (11.0, 3.6)
"""Width and height of the figure, inches; chosen."""


def errors_and_levels(trials: Sequence[Trial], risk: float) -> tuple[Floats, Floats]:
    """Return the errors and protection levels (n, 3) of all published poses."""
    shown = [t for t in trials if t.error is not None and t.covariance is not None]
    errors = np.array([t.error for t in shown]).reshape(-1, 3)
    levels = np.array([
        protection_level(t.covariance, Pose2(0.0, 0.0, 0.0), EXACT, risk)
        for t in shown if t.covariance is not None
    ]).reshape(-1, 3)
    return np.abs(errors), levels


def misleading(trials: Sequence[Trial], risk: float) -> Bools:
    """Return for each published pose whether an error exceeds its level, (n,)."""
    errors, levels = errors_and_levels(trials, risk)
    return np.asarray((errors > levels).any(axis=1))


def notes(trials: Sequence[Trial]) -> list[str]:
    """Return a sentence per risk: misleading poses, their bound, and the size of the levels."""
    found = []
    for risk in RISKS:
        wrong = misleading(trials, risk)
        count, total = int(wrong.sum()), len(wrong)
        if not total:
            continue
        most = float(beta.ppf(SURE, count + 1, total - count)) if count < total else 1.0
        _, levels = errors_and_levels(trials, risk)
        sizes = ', '.join(
            f'{name} {factor * np.median(level):.3g} {unit}'
            for (name, unit, factor), level in zip(AXES, levels.T, strict=True)
        )
        found.append(
            f'Protection level at a risk of {risk:g}: {count} of {total} poses misleading (at '
            f'most {most:.2g} with {SURE:.0%}); median level {sizes}.'
        )
    return found


def misleading_bounds(row: str, trials: Sequence[Trial]) -> list[Bound]:
    """Return per risk the bound on the number of misleading poses that chance explains."""
    found = []
    for risk in RISKS:
        wrong = misleading(trials, risk)
        most = float(binom.ppf(SURE, len(wrong), risk)) if len(wrong) else 0.0
        found.append(Bound(row, f'misleading poses at a risk of {risk:g}', int(wrong.sum()), most))
    return found


def stanford_diagram(trials: Sequence[Trial], risk: float) -> Figure:
    """Draw error against protection level; above the diagonal a pose is misleading."""
    errors, levels = errors_and_levels(trials, risk)
    figure = Figure(figsize=SIZE, layout='constrained')
    panels = figure.subplots(1, 3)
    for axes, (name, unit, factor), error, level in zip(
        panels, AXES, errors.T, levels.T, strict=True
    ):
        wrong = error > level
        for chosen, color in ((~wrong, ESTIMATE), (wrong, WRONG)):
            axes.loglog(factor * error[chosen], factor * level[chosen], '.', ms=3, color=color)
        low, high = _limits(factor * np.concatenate([error, level]))
        axes.plot([low, high], [low, high], color='0.2', lw=1.0)
        axes.fill_between([low, high], [low, low], [low, high], color=WRONG, alpha=0.08, lw=0)
        axes.set(xlim=(low, high), ylim=(low, high), title=name,
                 xlabel=f'error [{unit}]', ylabel=f'protection level [{unit}]')
    figure.suptitle(f'Risk {risk:g}: {len(errors)} poses; red area: misleading', fontsize=9)
    return figure


def _limits(values: Floats) -> tuple[float, float]:
    positive = values[values > 0.0]
    if not len(positive):
        return 0.1, 10.0
    return 0.8 * float(max(positive.min(), 1e-4 * positive.max())), 1.3 * float(positive.max())
