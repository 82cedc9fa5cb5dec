# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Statistics of the last frames: time between images, and time of their processing."""

from __future__ import annotations

from collections import deque

import numpy as np

from gip_localizer.core.track.stamp_check import REWIND_NS

TIMED_FRAMES = 100
"""Number of frames over which rates and percentiles are computed; chosen: 10 s at 10 Hz."""


class FrameTiming:
    """Keeps stamps and execution times of the last `TIMED_FRAMES` frames."""

    def __init__(self) -> None:
        self._stamps: deque[int] = deque(maxlen=TIMED_FRAMES)
        self._times_ms: deque[float] = deque(maxlen=TIMED_FRAMES)

    def add_stamp(self, stamp_ns: int) -> None:
        """Add the stamp of an image, ns; 0, which means not stamped, is left out."""
        if self._stamps and self._stamps[-1] - stamp_ns > REWIND_NS:
            self._stamps.clear()
        if stamp_ns:
            self._stamps.append(stamp_ns)

    def forget_stamps(self) -> None:
        """Begin again after a time jump."""
        self._stamps.clear()

    def add_time(self, milliseconds: float) -> None:
        """Add the execution time of a frame, ms."""
        self._times_ms.append(milliseconds)

    def period_ms(self) -> float:
        """Return the time between images, ms: a low percentile, since drops lengthen gaps."""
        gaps = np.diff(np.fromiter(self._stamps, np.int64)) * 1e-6
        return float(np.percentile(gaps, 10.0)) if len(gaps) else 0.0

    def slow(self) -> str:
        """Return how the processing is slower than the images arrive; empty if it is not."""
        period = self.period_ms()
        if len(self._times_ms) < TIMED_FRAMES or not 0.0 < period < self._percentile(50):
            return ''
        return f'{self._percentile(50):.0f} ms per frame, one image every {period:.0f} ms'

    def figures(self) -> dict[str, str]:
        """Return image rate and percentiles of the execution time, by key."""
        figures = {}
        if (period := self.period_ms()) > 0.0:
            figures['image_rate'] = f'{1e3 / period:.3g}'
        for percent in (50, 95) if self._times_ms else ():
            figures[f'execution_time_p{percent}_ms'] = f'{self._percentile(percent):.2f}'
        return figures

    def _percentile(self, percent: float) -> float:
        return float(np.percentile(self._times_ms, percent))
