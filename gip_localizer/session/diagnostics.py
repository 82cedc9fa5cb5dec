# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""State of a run: which rules of `session.diagnostic_rules` hold now, and the figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
import time

import numpy as np

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.protection import PROTECTION
from gip_localizer.parameters.integration import Diagnostics
from gip_localizer.session.diagnostic_figures import counter_figures, estimate_figures
from gip_localizer.session.diagnostic_report import Report
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS
from gip_localizer.session.frame_timing import FrameTiming

EVENT_TIME = 10.0
"""Time (s) for which a single event is reported; chosen: about ten messages at 1 Hz."""
AGES = {'image': 'image_age', 'odom': 'odometry_age', 'pose': 'pose_age'}
EVENTS = {'odom': 'ODOMETRY_REFUSED', 'initialpose': 'INITIALPOSE_REFUSED'}
LASTING = {'camera_info': 'CAMERA_INFO_REFUSED', 'initialpose': 'INITIALPOSE_REFUSED'}
"""Role → rule of a refused message: `EVENTS` for `EVENT_TIME`, `LASTING` until a good message."""


@dataclass
class HealthMonitor:
    """
    Collects the events of a run and reports which diagnostic rules hold.

    Attributes
    ----------
    limits : Diagnostics
        Limits from which messages are late or missing.
    fixed : dict
        Figures that do not change, such as those of the map.
    simulated : bool
        Whether the clock comes from /clock.
    active : bool
        False: frames are ignored, since the managed node is not active.
    enabled : bool
        False: frames are ignored on request.
    steady : callable
        Seconds of a steady clock.
    lasting, warnings : dict
        Name → detail of the rules that hold until removed, and of those of the last frame.
    overtaken : int
        Images that were dropped because a newer image had its mask first.
    searching : bool
        Whether the current frame is searched for on the whole map.
    publisher_hint : callable
        Takes `image` or `camera_info`; returns the topic's name and its publishers.

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
    publisher_hint: Callable[[str], str] = 'is {} remapped?'.format
    frames: int = 0
    published: int = 0
    _at: dict[str, float] = field(default_factory=dict)
    _events: dict[str, tuple[float, str]] = field(default_factory=dict)
    _complaints: Mapping[str, str] = field(default_factory=dict)
    _counts: Mapping[str, int] = field(default_factory=dict)
    _timing: FrameTiming = field(default_factory=FrameTiming)
    _delay: float = 0.0
    _busy: tuple[float, float] = (0.0, 0.0)
    _clock: tuple[int, float] | None = None

    @property
    def accepts_frames(self) -> bool:
        """Whether frames are localized."""
        return self.active and self.enabled

    def on_image(self, stamp_ns: int, clock_ns: int) -> None:
        """Record an image: its stamp, and the clock at its arrival."""
        self._timing.add_stamp(stamp_ns)
        self.frames += 1
        self._at['image'] = self.steady()
        if stamp_ns == 0:  # not stamped; the estimate reports it
            return
        # A simulated clock shows 0 until the first message on /clock.
        self._delay = (clock_ns - stamp_ns) * 1e-9 if clock_ns else 0.0

    def on_odometry(self) -> None:
        """Record the arrival of an odometry message."""
        self._at['odom'] = self.steady()

    def on_time_jump(self, seconds: float) -> None:
        """Record that stamps or the clock went back."""
        self._timing.forget_stamps()
        self.add_event('TIME_WENT_BACK', f'by {seconds:.3f} s')

    def add_event(self, rule: str, detail: str) -> None:
        """Report a rule for `EVENT_TIME`."""
        self._events[rule] = (self.steady(), detail)

    def set_rule(self, rule: str, detail: str) -> None:
        """Report a rule from now on; with an empty detail, stop reporting it."""
        self.lasting.pop(rule, None)
        if detail:
            self.lasting[rule] = detail

    def frame_started(self, *, search: bool = False) -> None:
        """Record that processing of a frame has begun; messages are processed after it."""
        self._busy = (self.steady(), np.inf)
        self.searching = search

    def frame_finished(self, estimate: Estimate, milliseconds: float) -> None:
        """Record the outcome of a frame and its processing time."""
        self.estimate = estimate
        self.searching = False
        self._timing.add_time(milliseconds)
        self._busy = (self.steady() - 1e-3 * milliseconds, self.steady())
        self.published += estimate.published
        if estimate.published:
            self._at['pose'] = self.steady()

    def update_inputs(self, complaints: Mapping[str, str], counts: Mapping[str, int]) -> None:
        """Record, by topic, the faults of the last messages and the numbers of messages."""
        for topic, rule in EVENTS.items():
            refused = f'{topic}_refused'
            if topic in complaints and counts.get(refused) != self._counts.get(refused):
                self.add_event(rule, complaints[topic])
        self._complaints, self._counts = dict(complaints), dict(counts)

    def on_clock(self, clock_ns: int) -> None:
        """Record the clock; called often, so that a stopped clock is detected."""
        if self._clock is None or self._clock[0] != clock_ns:
            self._clock = (clock_ns, self.steady())

    def reports(self) -> list[Report]:
        """Return one report per group, in the order of `DIAGNOSTIC_GROUPS`."""
        active = self._active()
        figures = self._figures()
        reports = []
        for group in DIAGNOSTIC_GROUPS:
            held = tuple(rule for rule in group.rules if rule.name in active)
            said = [_message(rule.name, active[rule.name]) for rule in held]
            message = '; '.join(said) or _message('OK', self._ok_detail(group.name))
            own = {key: figures[key] for key in group.figures if key in figures}
            reports.append(Report(group, held, message, own))
        return reports

    def _active(self) -> dict[str, str]:
        """Return the names of all rules that hold, and their details."""
        now = self.steady()
        active = {
            name: detail for name, (since, detail) in self._events.items()
            if now - since < EVENT_TIME
        } | self.lasting | self.warnings  # fmt: skip
        active |= self._timeouts() | self._stamp_faults()
        active |= {rule: self._complaints[role] for role, rule in LASTING.items()
                   if role in self._complaints}
        if self.estimate is not None and self.estimate.status is not Status.TRACKING:
            active[str(self.estimate.status)] = self.estimate.reason
        if self.estimate is not None and self.estimate.quality.get('protection_valid') == 0.0:
            active['ALERT_LIMIT'] = ', '.join(
                f'{name} {self.estimate.quality[name]:.3g}' for name in PROTECTION
            )
        if self.searching:
            active['SEARCHING'] = f'for {self.steady() - self._busy[0]:.1f} s'
        if slow := self._timing.slow():
            active['SLOW'] = slow
        return active | self._withheld(active)

    def _timeouts(self) -> dict[str, str]:
        limits, found = self.limits, {}
        silent = {what: self._seconds_without(at) for what, at in self._at.items()}
        image_age, odom_age = silent.get('image'), silent.get('odom')
        if image_age is None:
            found['NO_IMAGE_YET'] = self.publisher_hint('image')
        elif image_age > limits.camera_timeout:
            found['NO_IMAGE'] = f'for {image_age:.1f} s; {self.publisher_hint("image")}'
        if self.simulated and self._clock is not None:
            still = self._seconds_without(self._clock[1])
            if still > limits.camera_timeout:
                found['CLOCK_STOPPED'] = f'for {still:.1f} s; is /clock published?'
        if not self._counts.get('camera_info'):
            found['NO_CAMERA_INFO_YET'] = self.publisher_hint('camera_info')
        if odom_age is not None and odom_age > limits.odometry_timeout:
            found['ODOMETRY_STALE'] = f'none for {odom_age:.1f} s'
        return found

    def _seconds_without(self, at: float) -> float:
        """Return the seconds without a message, except while a frame was processed."""
        start, end = self._busy
        return self.steady() - at - max(end - max(at, start), 0.0)

    def _stamp_faults(self) -> dict[str, str]:
        hint = 'synchronize the clocks of camera and computer; for a bag set use_sim_time'
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

    def _ok_detail(self, group: str) -> str:
        if group == 'output' and self.estimate is not None:
            return f'{self.estimate.status}: {self.estimate.reason}'
        none_came = group == 'odometry' and 'odom' not in self._at
        return 'no message received; the last velocity is used' if none_came else ''

    def _ages(self) -> dict[str, float]:
        return {what: self.steady() - at for what, at in self._at.items()}

    def _figures(self) -> dict[str, str]:
        """Return every figure that is known, by key."""
        figures = {**self.fixed, 'frames': str(self.frames), 'published': str(self.published)}
        if self.frames:
            figures['availability'] = f'{self.published / self.frames:.4f}'
            figures['image_delay'] = f'{self._delay:.4f}'
        figures |= {AGES[what]: f'{age:.3f}' for what, age in self._ages().items()}
        figures |= {'prediction': self.prediction, 'images_overtaken': str(self.overtaken)}
        figures |= counter_figures(self._counts) | self._timing.figures()
        return figures | ({} if self.estimate is None else estimate_figures(self.estimate))


def _message(name: str, detail: str) -> str:
    return f'{name}: {detail}' if detail else name
