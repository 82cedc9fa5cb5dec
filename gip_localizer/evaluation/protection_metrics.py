# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The protection level of a run in `metrics.json`: its size, and how often it was exceeded."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from gip_localizer.core.protection import PROTECTION
from gip_localizer.evaluation.error_table import ErrorTable
from gip_localizer.evaluation.run import FrameResult


def protection_metrics(estimates: Sequence[FrameResult], table: ErrorTable) -> dict[str, Any]:
    """
    Return median levels, the share of valid ones, and the number of exceeded ones.

    Parameters
    ----------
    estimates : sequence of FrameResult
        Every frame of a run; those without the figures of a protection level do not count.
    table : ErrorTable
        Of the same frames.

    """
    levels = np.array([
        [estimate.quality.get(name, np.nan) for name in PROTECTION] for estimate in estimates
    ]).reshape(-1, 3)
    known = np.isfinite(levels).all(axis=1)
    judged = known & table.judged
    valid = np.array([estimate.quality.get('protection_valid', np.nan) for estimate in estimates])
    exceeded = (np.abs(table.body[judged]) > levels[judged]).any(axis=1)
    medians = np.median(levels[known], axis=0).tolist() if known.any() else [None] * 3
    return {
        'misleading': int(exceeded.sum()) if judged.any() else None,
        'valid': float(np.mean(valid[known])) if known.any() else None,
        **{f'median_{name.removeprefix("protection_")}': value
           for name, value in zip(PROTECTION, medians, strict=True)},
    }
