# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Fit of the tails of the protection level, run by `make fit-protection`.

The errors of the development matches, divided by their standard deviations, are bounded by a
Student t distribution: its degrees of freedom are the most likely ones, its scale the least at
which the distribution exceeds the measured share of every error in the tail. Errors ahead and to
the left share one distribution, since what separates them is the direction of the view alone.

"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.stats import t

from gip_localizer.core import protection_terms
from gip_localizer.core.arrays import Floats
from gip_localizer.core.threads import use_one_thread
from gip_localizer.evaluation.development import development_matches, SEEDS, SETUPS
from gip_localizer.evaluation.suites.conditions import Setup
from gip_localizer.evaluation.suites.model_error import ModelError

FREEDOM = (3.0, 30.0)
"""Limits of the degrees of freedom (no unit); chosen: below 3 the variance is hardly defined."""
TAIL = 0.1
"""Share of the errors, the largest ones, that the fit bounds one by one; chosen."""
AXES = ('position', 'heading')
TERMS = Path(protection_terms.__file__)


def main() -> int:
    """Fit, print and write the tails."""
    argparse.ArgumentParser(
        prog='make fit-protection',
        description='Fit the tails of the protection level to the errors of matches on '
                    'development worlds, and write core/protection_terms.py. It takes ten minutes '
                    'on one core.',
    ).parse_args()
    use_one_thread()
    errors = np.array([
        normalized for setup in SETUPS if _yaw_is_exact(setup) for seed in SEEDS
        for normalized in _normalized_errors(setup, seed)
    ])
    position, heading = errors[:, :2].ravel(), errors[:, 2]
    tails = [bounding_tail(position), bounding_tail(heading)]
    for name, column, (freedom, scale) in zip(AXES, (position, heading), tails, strict=True):
        sys.stdout.write(
            f'{name:8s} {len(column)} errors, largest {np.abs(column).max():.1f} standard '
            f'deviations: {freedom:.1f} degrees of freedom, scale {scale:.2f}\n'
        )
    TERMS.write_text(terms_module(*tails), encoding='utf-8')
    return 0


def _yaw_is_exact(setup: Setup) -> bool:
    """Return whether the camera's yaw is calibrated exactly: its error is bounded by itself."""
    return not (isinstance(setup, ModelError) and setup.miscalibration.yaw)


def _normalized_errors(setup: Setup, seed: int) -> list[Floats]:
    """Return the errors (3,) of a world in standard deviations."""
    return [
        error / np.sqrt(np.diag(fit.covariance))
        for error, fit in development_matches(setup, seed, {'camera.sigma_yaw': 0.0})
    ]


def bounding_tail(errors: Floats) -> tuple[float, float]:
    """
    Return degrees of freedom and scale of the Student t that bounds errors.

    Parameters
    ----------
    errors : (n,)
        In standard deviations.

    """
    sizes = np.sort(np.abs(errors))[::-1]
    spread = float(np.median(sizes)) / float(t.isf(0.25, 5.0))

    def unlikeliness(freedom: float) -> float:
        return -float(t.logpdf(sizes, freedom, scale=spread).sum())

    freedom = round(float(minimize_scalar(unlikeliness, bounds=FREEDOM, method='bounded').x), 1)
    count = max(int(TAIL * len(sizes)), 1)
    shares = (np.arange(count) + 1.0) / len(sizes)
    scale = float((sizes[:count] / t.isf(0.5 * shares, freedom)).max())
    return freedom, round(scale, 2)


def terms_module(position: tuple[float, float], heading: tuple[float, float]) -> str:
    """Return the text of the module of the core that holds a fit."""
    return f'''\
# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Tails of the errors: written by `make fit-protection`, not by hand."""

TAILS = ({position!r}, {position!r}, {heading!r})
"""Ahead, left, heading: degrees of freedom and scale of the Student t that bounds the error."""
'''


if __name__ == '__main__':
    sys.exit(main())
