# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures of `/diagnostics` from message counts and from an estimate, as text by key."""

from __future__ import annotations

from collections.abc import Mapping

from gip_localizer.core.estimate import Estimate

COUNTERS = {
    'image': ('', 'images_refused'), 'camera_info': ('camera_infos', 'camera_infos_refused'),
    'mask': ('masks', 'masks_refused'), 'odom': ('odometries', 'odometries_refused'),
    'initialpose': ('initialposes', 'initialposes_refused'),
}  # fmt: skip
"""Topic → keys of the number of messages received (empty: not reported) and refused."""


def counter_figures(counts: Mapping[str, int]) -> dict[str, str]:
    """Return numbers of received and of refused messages, from counts by topic."""
    figures = {}
    for topic, names in COUNTERS.items():
        for name, key in zip(names, (topic, f'{topic}_refused'), strict=True):
            figures[name] = str(counts.get(key, 0))
    return figures


def estimate_figures(estimate: Estimate) -> dict[str, str]:
    """Return the quality figures of a frame, and the times (ms) of its steps."""
    figures = {name: f'{value:.6g}' for name, value in estimate.quality.items()}
    return figures | {f'{name}_ms': f'{ms:.3f}' for name, ms in estimate.timings_ms.items()}
