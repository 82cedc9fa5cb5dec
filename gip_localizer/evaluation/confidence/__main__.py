# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
`make fit-confidence`: fit the confidence again, and print what it rests on.

Without `--trials` from the kept figures, in seconds; with it the trials are made first, which
takes a quarter of an hour on one core.

"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

from matplotlib import rc_context

from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.confidence import trials
from gip_localizer.evaluation.confidence.chart import Bin, reliability, reliability_figure
from gip_localizer.evaluation.confidence.fit import Design, regress, Regression, select
from gip_localizer.visualization.style import STYLE

ROOT = Path(__file__).parents[3]
TERMS = ROOT / 'gip_localizer' / 'core' / 'confidence_terms.py'
FIGURE = ROOT / 'docs' / 'figures' / 'confidence.png'
DPI = 90
"""Resolution of the figure, pixels per inch; chosen."""


def main(words: list[str] | None = None) -> int:
    """Run the command; 0 when it is done."""
    parser = argparse.ArgumentParser(prog='fit-confidence', description=__doc__)
    parser.add_argument('--trials', action='store_true', help='make the trials again first')
    parser.add_argument('--write', action='store_true',
                        help=f'write {TERMS.relative_to(ROOT)} and {FIGURE.relative_to(ROOT)}')
    options = parser.parse_args(words)
    if options.trials:
        _make_trials()
    kept = trials.read(trials.KEPT)
    design = Design.of(kept)
    columns = select(design)
    fitted = regress(design, columns)
    bins = reliability(design, design.left_out(columns))
    sys.stdout.write(report(kept, design, columns, fitted, bins))
    if options.write:
        TERMS.write_text(terms_module(fitted), encoding='utf-8')
        with rc_context(STYLE):
            reliability_figure(bins).savefig(FIGURE, dpi=DPI, metadata={'Software': None})
    return 0


def _make_trials() -> None:
    use_one_thread()
    made: list[trials.ConfidenceTrial] = []
    for world, setup in trials.trial_jobs():
        made += trials.make_trials(setup, world)
        sys.stdout.write(f'{world} {setup.name}: {len(made)} matches\n')
        sys.stdout.flush()
    trials.write(trials.KEPT, made)


def report(
    kept: list[trials.ConfidenceTrial], design: Design, columns: tuple[int, ...],
    fitted: Regression, bins: list[Bin],
) -> str:
    """Return what the fit rests on, its numbers, and how reliable it is."""
    right = int(design.right.sum())
    lines = [
        f'{right} right and {len(kept) - right} wrong matches of '
        f'{len({t.part for t in kept})} parts in {len({t.world for t in kept})} worlds', '',
        'figure            weight      from        to  log loss of left-out parts without it',
    ]
    for term, column in zip(fitted.terms, columns, strict=True):
        without = design.loss(design.left_out([other for other in columns if other != column]))
        lines.append(
            f'{term.figure:16s} {term.weight:7.3g} {term.low:9.3g} {term.high:9.3g}  {without:.4f}'
        )
    left = [name for name in design.names if name not in {t.figure for t in fitted.terms}]
    lines += [
        f'with all of them{design.loss(design.left_out(columns)):35.4f}',
        f'offset           {fitted.offset:7.3g}',
        'not taken: ' + (', '.join(left) or 'none'), '',
        'confidence   right  wrong  mean confidence  share right',
    ]
    lines += [
        f'{b.low:.2f} to {b.high:.2f} {b.right:6d} {b.wrong:6d} {b.expected:16.3f} {b.found:12.3f}'
        for b in bins
    ]
    return '\n'.join(lines) + '\n'


def terms_module(fitted: Regression) -> str:
    """Return the text of the module of the core that holds a fit."""
    terms = ''.join(f'    {term!r},\n' for term in fitted.terms)
    return f'''\
# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What the confidence consists of: written by `make fit-confidence`, not by hand."""

from gip_localizer.core.confidence import Term

OFFSET = {fitted.offset!r}
"""Log odds of a right match where the logarithms of all figures are zero."""
TERMS = (
{terms})
"""Figures of a match that predict whether it is right, and the weight of each (no unit)."""
'''


if __name__ == '__main__':
    raise SystemExit(main())
