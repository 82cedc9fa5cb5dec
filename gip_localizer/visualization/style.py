# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Colours and settings that all figures share; all are chosen, font sizes in points."""

from __future__ import annotations

from typing import Any

ESTIMATE, TRUTH, WRONG, BAND = '#1768ac', '#1b8a3d', '#c1121f', '#9fc5e8'
STYLE: dict[Any, Any] = {
    'font.size': 9.0, 'axes.grid': True, 'grid.alpha': 0.3, 'axes.axisbelow': True,
    'axes.spines.top': False, 'axes.spines.right': False, 'svg.hashsalt': 'gip_localizer',
    'legend.frameon': False, 'figure.constrained_layout.use': True,
}
