# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Style of the figures of `gip paper`, and how they are saved: same input, same bytes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
from matplotlib.figure import Figure

# As in the paper: dashed blue and solid black, distinguishable in print and if colour-blind.
COLORS = {'standard': '#2166ac', 'generalized': '#111111'}
LINES = {'standard': '--', 'generalized': '-'}
STYLE: dict[Any, Any] = {
    'font.size': 9.5, 'axes.grid': True, 'grid.alpha': 0.3, 'axes.axisbelow': True,
    'axes.spines.top': False, 'axes.spines.right': False, 'legend.frameon': False,
    'svg.hashsalt': 'gip_localizer', 'svg.fonttype': 'path',
}


def styled() -> Any:
    """Return the context in which figures are made and saved."""
    return matplotlib.rc_context(STYLE)


def save_figure(figure: Figure, folder: Path, name: str) -> None:
    """Write `name`.png and `name`.svg without dates."""
    figure.savefig(folder / f'{name}.png', dpi=150, metadata={'Software': None})
    figure.savefig(folder / f'{name}.svg', metadata={'Date': None, 'Creator': None})
