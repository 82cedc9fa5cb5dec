# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The 100 × 2 points printed in Fig. SimResultsD8 of the paper.

`printed_points.csv` holds them as in the source of the figure (columns amplitude, standard,
generalized). They apply only to the 66 squares of the paper's camera.

"""

from __future__ import annotations

from importlib import resources

import numpy as np

from gip_localizer.core.arrays import Floats

PRINTED_SAMPLES = 10_000
"""Number of sampled pairs per printed point, from the paper."""


def printed_points() -> tuple[Floats, Floats, Floats]:
    """Return amplitudes, standard and generalized probabilities of error, (100,) each."""
    source = resources.files('gip_localizer.paper') / 'printed_points.csv'
    with source.open(encoding='utf-8') as file:
        table = np.loadtxt(file, delimiter=',', skiprows=1)
    return table[:, 0], table[:, 1], table[:, 2]
