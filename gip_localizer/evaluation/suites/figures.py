# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Charts of an evaluation: errors, NEES and bounds; confidence of right and wrong matches."""

from __future__ import annotations

from collections.abc import Sequence

from matplotlib.figure import Figure
import numpy as np

from gip_localizer.evaluation.report_figures import NEES_95
from gip_localizer.evaluation.suites.conditions import CONDITIONS
from gip_localizer.evaluation.suites.integrity import confidences, GROUPS
from gip_localizer.evaluation.suites.protection import stanford_diagram
from gip_localizer.evaluation.suites.suite import of_part, Record
from gip_localizer.visualization.style import ESTIMATE, WRONG

DIAGRAM_RISK = 1e-5
"""Risk of the protection levels in the Stanford diagram, probability per frame; chosen."""
SIZE, WIDE = (7.2, 3.4), (11.0, 3.2)
"""Widths and heights of charts, inches; chosen."""


def charts(records: Sequence[Record], least_confidence: float) -> dict[str, Figure]:
    """Return the figures for which there are records, by file name."""
    figures = {}
    single = [r for r in records if r.suite == 'conditions']
    if any(r.trial.error is not None for r in single):
        figures['conditions'] = error_chart(single)
    integrity = [r for r in records if r.suite == 'integrity']
    if integrity:
        figures['integrity'] = confidence_chart(integrity, least_confidence)
        figures['stanford'] = stanford_diagram([r.trial for r in integrity], DIAGRAM_RISK)
    return figures


def error_chart(records: Sequence[Record]) -> Figure:
    """Draw error and NEES of each published frame by condition, with the bounds on the rmse."""
    figure = Figure(figsize=SIZE)
    left, right = figure.subplots(1, 2)
    names = [c.name for c in CONDITIONS]
    for place, condition in enumerate(CONDITIONS):
        trials = [r.trial for r in of_part(records, condition.name)]
        shown = [t for t in trials if t.error is not None]
        across = place + np.linspace(-0.3, 0.3, max(len(shown), 1))[: len(shown)]
        errors = [1e3 * np.hypot(*t.error[:2]) for t in shown if t.error is not None]
        left.semilogy(across, errors, '.', ms=2.5, color=ESTIMATE)
        left.hlines(1e3 * condition.rmse_xy_m, place - 0.4, place + 0.4, color=WRONG, lw=1.5)
        right.semilogy(across, [t.nees for t in shown], '.', ms=2.5, color=ESTIMATE)
    left.set_ylabel('error [mm]; red: bound on the rmse')
    right.axhspan(*NEES_95, color='0.85', lw=0)
    right.set_ylabel('NEES; grey: 95 % of frames')
    for axes in (left, right):
        axes.set_xticks(range(len(names)), names, rotation=45, ha='right')
    return figure


def confidence_chart(records: Sequence[Record], least_confidence: float) -> Figure:
    """Draw the distribution of the confidence of right and of wrong matches, by group."""
    figure = Figure(figsize=WIDE)
    panels = figure.subplots(1, len(GROUPS), sharey=True)
    bins = np.linspace(0.0, 1.0, 26)
    for axes, (group, setups) in zip(panels, GROUPS.items(), strict=True):
        of_group = [r for s in setups for r in of_part(records, s.name)]
        for right, color, label in ((True, ESTIMATE, 'right'), (False, WRONG, 'wrong')):
            values = confidences(of_group, right=right)
            if len(values):
                share = np.full(len(values), 1.0 / len(values))
                axes.hist(values, bins, weights=share, color=color, alpha=0.6, label=label)
        axes.axvline(least_confidence, color='0.2', lw=1.0, ls='--')
        axes.set_title(group, fontsize=9)
        axes.set_xlabel('confidence')
    panels[0].set_ylabel('share of matches')
    panels[0].legend(fontsize=8)
    return figure
