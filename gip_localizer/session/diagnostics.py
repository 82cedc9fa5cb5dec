# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""State of a run: which rules of `session.diagnostic_rules` hold now, and the figures."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
import time

import numpy as np

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.track.stamp_check import REWIND_NS
from gip_localizer.parameters.integration import Diagnostics
from gip_localizer.session.diagnostic_rules import (
    DIAGNOSTIC_GROUPS,
    DiagnosticGroup,
    Rule,
    Severity,
)

REMEMBERED = 10.0
"""Time (s) for which a passing fault is told."""
RECENT = 100
"""Frames over which times are summed up."""
AGES = {'image': 'image_age', 'odom': 'odometry_age', 'pose': 'pose_age'}
PASSING = {'odom': 'ODOMETRY_REFUSED', 'initialpose': 'INITIALPOSE_REFUSED'}
LASTING = {'camera_info': 'CAMERA_INFO_REFUSED', 'initialpose': 'INITIALPOSE_REFUSED'}
"""Role → the rule of a refused message: said for `REMEMBERED`, and until a good one comes."""
COUNTED = {
    'image': ('', 'images_refused'), 'camera_info': ('camera_infos', 'camera_infos_refused'),
    'mask': ('masks', 'masks_refused'), 'odom': ('odometries', 'odometries_refused'),
    'initialpose': ('initialposes', 'initialposes_refused'),
}  # fmt: skip


@dataclass(frozen=True)
class Report:
    """What is to be said of one group: the rules that hold, first things first."""

    group: DiagnosticGroup
    rules: tuple[Rule, ...]
    message: str
    figures: dict[str, str]

    @property
    def rule(self) -> Rule | None:
        """The first that holds."""
        return next(iter(self.rules), None)

    @property
    def level(self) -> Severity:
        """The worst of the rules; OK without any."""
        return max((rule.level for rule in self.rules), default=Severity.OK)


@dataclass
class HealthMonitor:
    """
    Takes what happens, tells what is the matter.

    Attributes
    ----------
    limits : Diagnostics
        When messages are late or missing.
    fixed : dict
        Figures that do not change, such as those of the map.
    simulated : bool
        The clock comes from /clock.
    active : bool
        False: frames are ignored, since the managed node is not active.
    enabled : bool
        False: frames are ignored on request.
    steady : callable
        Seconds that never go back.
    lasting, warnings : dict
        Rules that hold until taken out, and of the last frame, and their details.
    overtaken : int
        Images that a newer one with its mask overtook.
    searching : bool
        The frame in work is searched for on the whole map.
    waited_for : callable
        Takes `image` or `camera_info`; returns the topic's name and who publishes on it.

    """

    limits: Diagnostics
    fixed: Mapping[str, str] = field(default_factory=dict)
    simulated: bool = False
    active: bool = True
    enabled: bool = True
    steady: Callable[[], float] = time.monotonic
    lasting: dict[str, str] = field(default_factory=dict)
    estimate: Estimate | None = None
    prediction: str = 'none'
    warnings: dict[str, str] = field(default_factory=dict)
    overtaken: int = 0
    searching: bool = False
    waited_for: Callable[[str], str] = 'is {} remapped?'.format
    frames: int = 0
    published: int = 0
    _at: dict[str, float] = field(default_factory=dict)
    _events: dict[str, tuple[float, str]] = field(default_factory=dict)
    _complaints: Mapping[str, str] = field(default_factory=dict)
    _counts: Mapping[str, int] = field(default_factory=dict)
    _stamps: deque[int] = field(default_factory=lambda: deque(maxlen=RECENT))
    _times_ms: deque[float] = field(default_factory=lambda: deque(maxlen=RECENT))
    _delay: float = 0.0
    _busy: tuple[float, float] = (0.0, 0.0)
    _clock: tuple[int, float] | None = None

    @property
    def wanted(self) -> bool:
        """Whether frames are to be localized."""
        return self.active and self.enabled

    def image_came(self, stamp_ns: int, clock_ns: int) -> None:
        """Note an image: its stamp, and the clock at its arrival."""
        if self._stamps and self._stamps[-1] - stamp_ns > REWIND_NS:
            self._stamps.clear()
        self.frames += 1
        self._at['image'] = self.steady()
        if stamp_ns == 0:  # never stamped, which the estimate says
            return
        self._stamps.append(stamp_ns)
        # A simulated clock shows 0 until the first message on /clock.
        self._delay = (clock_ns - stamp_ns) * 1e-9 if clock_ns else 0.0

    def odometry_came(self) -> None:
        """Note an odometry message."""
        self._at['odom'] = self.steady()

    def time_went_back(self, seconds: float) -> None:
        """Note that stamps or the clock went back."""
        self._stamps.clear()
        self.happened('TIME_WENT_BACK', f'by {seconds:.3f} s')

    def happened(self, rule: str, detail: str) -> None:
        """Note a passing fault."""
        self._events[rule] = (self.steady(), detail)

    def begins(self, *, search: bool = False) -> None:
        """Note that a frame is in work, maybe on the whole map: what comes is heard after it."""
        self._busy = (self.steady(), np.inf)
        self.searching = search

    def took(self, estimate: Estimate, milliseconds: float) -> None:
        """Note the outcome of a frame, and how long it took."""
        self.estimate = estimate
        self.searching = False
        self._times_ms.append(milliseconds)
        self._busy = (self.steady() - 1e-3 * milliseconds, self.steady())
        self.published += estimate.published
        if estimate.published:
            self._at['pose'] = self.steady()

    def hear(self, complaints: Mapping[str, str], counts: Mapping[str, int]) -> None:
        """Note what is wrong with the last messages, and how many came, by topic."""
        for topic, rule in PASSING.items():
            refused = f'{topic}_refused'
            if topic in complaints and counts.get(refused) != self._counts.get(refused):
                self.happened(rule, complaints[topic])
        self._complaints, self._counts = dict(complaints), dict(counts)

    def clock_shows(self, clock_ns: int) -> None:
        """Note the clock; told often, so that a clock that stands is noticed."""
        if self._clock is None or self._clock[0] != clock_ns:
            self._clock = (clock_ns, self.steady())

    def reports(self) -> list[Report]:
        """Return one report per group, in the order of `DIAGNOSTIC_GROUPS`."""
        active = self._active()
        figures = self._figures()
        reports = []
        for group in DIAGNOSTIC_GROUPS:
            held = tuple(rule for rule in group.rules if rule.name in active)
            said = [_said(rule.name, active[rule.name]) for rule in held]
            message = '; '.join(said) or _said('OK', self._well(group.name))
            own = {key: figures[key] for key in group.figures if key in figures}
            reports.append(Report(group, held, message, own))
        return reports

    def _active(self) -> dict[str, str]:
        """Return the names of all rules that hold, and their details."""
        now = self.steady()
        active = {
            name: detail for name, (since, detail) in self._events.items()
            if now - since < REMEMBERED
        } | self.lasting | self.warnings  # fmt: skip
        active |= self._silences() | self._stamp_faults()
        active |= {rule: self._complaints[role] for role, rule in LASTING.items()
                   if role in self._complaints}
        if self.estimate is not None and self.estimate.status is not Status.TRACKING:
            active[str(self.estimate.status)] = self.estimate.reason
        if self.searching:
            active['SEARCHING'] = f'for {self.steady() - self._busy[0]:.1f} s'
        period = self._period_ms()
        if len(self._times_ms) == RECENT and 0.0 < period < self._percentile(50):
            active['SLOW'] = f'{self._percentile(50):.0f} ms a frame, one every {period:.0f} ms'
        return active | self._withheld(active)

    def _silences(self) -> dict[str, str]:
        limits, found = self.limits, {}
        silent = {what: self._silent_since(at) for what, at in self._at.items()}
        image_age, odom_age = silent.get('image'), silent.get('odom')
        if image_age is None:
            found['NO_IMAGE_YET'] = self.waited_for('image')
        elif image_age > limits.camera_timeout:
            found['NO_IMAGE'] = f'for {image_age:.1f} s; {self.waited_for("image")}'
        if self.simulated and self._clock is not None:
            still = self._silent_since(self._clock[1])
            if still > limits.camera_timeout:
                found['CLOCK_STOPPED'] = f'for {still:.1f} s; is /clock published?'
        if not self._counts.get('camera_info'):
            found['NO_CAMERA_INFO_YET'] = self.waited_for('camera_info')
        if odom_age is not None and odom_age > limits.odometry_timeout:
            found['ODOMETRY_STALE'] = f'none for {odom_age:.1f} s'
        return found

    def _silent_since(self, at: float) -> float:
        """Return for how long nothing came; what comes during a frame is heard after it."""
        start, end = self._busy
        return self.steady() - at - max(end - max(at, start), 0.0)

    def _stamp_faults(self) -> dict[str, str]:
        hint = 'do camera and computer share a clock? with a bag set use_sim_time'
        if self._delay > self.limits.max_delay:
            return {'LATE_FRAMES': f'{self._delay:.3f} s behind the clock; {hint}'}
        if -self._delay > self.limits.max_ahead:
            return {'FUTURE_STAMPS': f'{-self._delay:.3f} s ahead of the clock; {hint}'}
        return {}

    def _withheld(self, active: Mapping[str, str]) -> dict[str, str]:
        if not self.active:
            return {'DISABLED': 'images are ignored until the node is activated'}
        if not self.enabled:
            return {'DISABLED': 'images are ignored until ~/enable is called with data: true'}
        if 'NO_IMAGE' in active:
            return {'WITHHELD': f'NO_IMAGE: {active["NO_IMAGE"]}'}
        if 'SEARCHING' in active:
            return {'WITHHELD': f'SEARCHING: {active["SEARCHING"]}'}
        if self.estimate is None:
            return {'WAITING': ''}
        if not self.estimate.published:
            return {'WITHHELD': f'{self.estimate.status}: {self.estimate.reason}'}
        return {}

    def _well(self, group: str) -> str:
        if group == 'output' and self.estimate is not None:
            return f'{self.estimate.status}: {self.estimate.reason}'
        none_came = group == 'odometry' and 'odom' not in self._at
        return 'none has come; the last velocity is held' if none_came else ''

    def _ages(self) -> dict[str, float]:
        return {what: self.steady() - at for what, at in self._at.items()}

    def _period_ms(self) -> float:
        """Return the time between images, ms; dropped ones make longer gaps, not shorter."""
        gaps = np.diff(np.fromiter(self._stamps, np.int64)) * 1e-6
        return float(np.percentile(gaps, 10.0)) if len(gaps) else 0.0

    def _percentile(self, percent: float) -> float:
        return float(np.percentile(self._times_ms, percent))

    def _figures(self) -> dict[str, str]:
        """Return every figure that is known, by key."""
        figures = {**self.fixed, 'frames': str(self.frames), 'published': str(self.published)}
        if self.frames:
            figures['availability'] = f'{self.published / self.frames:.4f}'
            figures['image_delay'] = f'{self._delay:.4f}'
        figures |= {AGES[what]: f'{age:.3f}' for what, age in self._ages().items()}
        if (period := self._period_ms()) > 0.0:
            figures['image_rate'] = f'{1e3 / period:.3g}'
        for topic, names in COUNTED.items():
            for name, key in zip(names, (topic, f'{topic}_refused'), strict=True):
                figures[name] = str(self._counts.get(key, 0))
        figures |= {'prediction': self.prediction, 'images_overtaken': str(self.overtaken)}
        return figures | self._match_figures()

    def _match_figures(self) -> dict[str, str]:
        figures: dict[str, str] = {}
        for percent in (50, 95) if self._times_ms else ():
            figures[f'execution_time_p{percent}_ms'] = f'{self._percentile(percent):.2f}'
        if self.estimate is not None:
            figures |= {name: f'{value:.6g}' for name, value in self.estimate.quality.items()}
            figures |= {f'{name}_ms': f'{ms:.3f}' for name, ms in self.estimate.timings_ms.items()}
        return figures


def _said(name: str, detail: str) -> str:
    return f'{name}: {detail}' if detail else name
