# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The 100 × 2 points that the paper prints in Fig. SimResultsD8.

`printed_points.csv` holds them as the figure's source gives them (columns amplitude, standard,
generalized). They belong to the 66 squares of the paper's parameters and to no other camera.

"""

from __future__ import annotations

from importlib import resources

import numpy as np

from gip_localizer.core.arrays import Floats

PRINTED_SAMPLES = 10_000


def printed_points() -> tuple[Floats, Floats, Floats]:
    """Return amplitudes, standard and generalized probabilities of error, (100,) each."""
    source = resources.files('gip_localizer.paper') / 'printed_points.csv'
    with source.open(encoding='utf-8') as file:
        table = np.loadtxt(file, delimiter=',', skiprows=1)
    return table[:, 0], table[:, 1], table[:, 2]
