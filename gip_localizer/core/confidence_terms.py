# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What the confidence consists of: written by `make fit-confidence`, not by hand."""

from gip_localizer.core.confidence import Term

OFFSET = -1.76
"""Log odds of a right match where the logarithms of all figures are zero."""
TERMS = (
    Term(figure='margin', weight=1.8, low=0.01, high=2.72),
    Term(figure='significance', weight=1.55, low=0.01, high=25.7),
    Term(figure='sigma_cells', weight=-1.0, low=0.0114, high=3.72),
)
"""Figures of a match that predict whether it is right, and the weight of each (no unit)."""
