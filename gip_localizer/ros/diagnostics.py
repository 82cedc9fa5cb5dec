# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What the node tells of itself on `/diagnostics`: why a pose is published, or why none is."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
import time
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
import numpy as np
from std_msgs.msg import Header

from gip_localizer.core.estimate import Estimate

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STALE_AFTER = 1.0
"""A camera that is silent for longer (s) is reported."""
REMEMBERED = 10.0
"""Time (s) for which a message that could not be used is reported."""
RECENT = 100
"""Frames over which the execution time is summed up."""


class State(NamedTuple):
    """
    How the node fares.

    Attributes
    ----------
    level : bytes
        Of a DiagnosticStatus.
    word : str
        What is the matter: it changes when the situation does.
    detail : str
        With numbers, which change with every frame.

    """

    level: bytes
    word: str
    detail: str = ''

    def __str__(self) -> str:
        """Return the whole message."""
        return f'{self.word}: {self.detail}' if self.detail else self.word


@dataclass
class Health:
    """
    Counts and last words of a run; times are of the steady clock.

    Attributes
    ----------
    enabled : bool
        False: frames are ignored on request.
    frames, published : int
        Images that came and poses that went out.
    estimate : Estimate or None
        The last one.
    image_at : float or None
        When the last image came, seconds.

    """

    enabled: bool = True
    frames: int = 0
    published: int = 0
    estimate: Estimate | None = None
    image_at: float | None = None
    _complaints: dict[str, tuple[float, str]] = field(default_factory=dict)
    _times_ms: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))

    def took(self, estimate: Estimate, milliseconds: float) -> None:
        """Count a frame."""
        self.frames += 1
        self.published += estimate.published
        self.estimate = estimate
        self._times_ms.append(milliseconds)

    def hear(self, complaints: Mapping[str, str]) -> None:
        """Take what is wrong with the last messages, by topic; remember since when."""
        now = time.monotonic()
        self._complaints = {
            topic: known
            if (known := self._complaints.get(topic)) and known[1] == text
            else (now, text)
            for topic, text in complaints.items()
        }

    def state(self) -> State:
        """Return level, word and detail of the status."""
        if not self.enabled:
            return State(WARN, 'disabled by the service enable')
        state = self._camera_state()
        now = time.monotonic()
        recent = [
            f'{topic}: {text}' for topic, (since, text) in self._complaints.items()
            if now - since < REMEMBERED
        ]  # fmt: skip
        if not recent:
            return state
        detail = '; '.join([state.detail, *recent] if state.detail else recent)
        return State(max(state.level, WARN), state.word, detail)

    def _camera_state(self) -> State:
        if self.image_at is None:
            return State(WARN, 'no image has come yet')
        age = time.monotonic() - self.image_at
        if age > STALE_AFTER:
            return State(ERROR, 'no image', f'for {age:.0f} s')
        if self.estimate is None:
            return State(WARN, 'no frame has been localized yet')
        level = OK if self.estimate.published else ERROR
        return State(level, self.estimate.status.value, self.estimate.reason)

    def values(self) -> dict[str, str]:
        """Return the figures beside the message."""
        figures = {
            'frames': str(self.frames),
            'published': str(self.published),
        }
        if self._times_ms:
            for percent in (50, 95):
                percentile = np.percentile(self._times_ms, percent)
                figures[f'execution_time_p{percent}_ms'] = f'{percentile:.2f}'
        if self.estimate is not None:
            figures |= {name: f'{value:.6g}' for name, value in self.estimate.quality.items()}
            figures |= {f'{name}_ms': f'{ms:.3f}' for name, ms in self.estimate.timings_ms.items()}
        return figures


def diagnostic_array(health: Health, name: str, header: Header) -> DiagnosticArray:
    """Return the message for `/diagnostics`."""
    state = health.state()
    status = DiagnosticStatus(
        level=state.level, name=f'{name}: localization', message=str(state), hardware_id=name
    )
    status.values = [KeyValue(key=key, value=value) for key, value in health.values().items()]
    return DiagnosticArray(header=header, status=[status])
