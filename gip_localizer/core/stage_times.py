# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Duration of each stage of a frame."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import time


class StageTimes:
    """
    Measures how long the stages of one frame take.

    Attributes
    ----------
    milliseconds : dict
        Name of a finished stage → its duration, milliseconds.

    """

    def __init__(self) -> None:
        self.milliseconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Measure the body of a `with` statement, also if it raises an exception."""
        start = time.perf_counter()
        try:
            yield
        finally:
            self.milliseconds[name] = 1e3 * (time.perf_counter() - start)
