# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Run a bag through the localizer, message by message in log order, as the node does, without ROS.

Only the data for the results is kept, so that memory does not grow with the images.

"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
import sys
import time
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.estimate import Estimate
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.errors import BagError, ImageError
from gip_localizer.evaluation.camera_motion import correction_notes
from gip_localizer.evaluation.no_pose import desk_reason
from gip_localizer.evaluation.run import Run
from gip_localizer.evaluation.worst_frames import WorstFrames
from gip_localizer.evaluation.wrong_bounds import DEFAULT_BOUNDS, WrongBounds
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.source import BagMessage
from gip_localizer.io.bags.topics import IMAGES, Topics
from gip_localizer.io.bags.window import BagWindow
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.parameters import Parameters
from gip_localizer.session.dispatch import (
    CAMERA_INFO,
    Dispatch,
    IMAGE,
    INITIAL_POSE,
    MASK,
    ODOMETRY,
)
from gip_localizer.session.input_checks import rectified_warning
from gip_localizer.session.mask_sync import Frame

COMPRESSED = IMAGES[1:]


@dataclass
class Replay:
    """
    One pass over a bag.

    Attributes
    ----------
    bag : Bag
        The input.
    topics : Topics
        Topics to read.
    raster_map : RasterMap
        The map.
    parameters : Parameters
        Parameters of the localizer.
    truth : Trajectory or None
        Ground truth.
    wrong : WrongBounds
        Errors above which a pose is wrong.
    relocalize : bool
        True: the first frame is searched for on the whole map, without a prior.
    estimates : list of Estimate
        Estimates so far, without their `match`.

    """

    bag: Bag
    topics: Topics
    raster_map: RasterMap
    parameters: Parameters
    truth: Trajectory | None = None
    wrong: WrongBounds = DEFAULT_BOUNDS
    relocalize: bool = False
    estimates: list[Estimate] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Prepare the localizer."""
        self._dispatch = Dispatch(
            self.raster_map, self.parameters, partial(print, file=sys.stderr),
            compressed=self.topics.image.msgtype in COMPRESSED,
        )
        if self.relocalize:
            self._dispatch.relocalize()
        self._worst = WorstFrames(self.truth, self.raster_map)
        self._warnings: dict[str, tuple[int, str]] = {}
        warning = rectified_warning(
            self.topics.image.name, rectified=self.parameters.camera.rectified
        )
        self._notes: list[str] = [warning] if warning else []
        self._seconds = 0.0
        self._complete = False

    def run(self, window: BagWindow, on_frame: Callable[[Estimate], None]) -> None:
        """
        Replay the bag; after Ctrl-C the run ends early and `result` is marked incomplete.

        Parameters
        ----------
        window : BagWindow
            Part of the bag.
        on_frame : callable
            Called with each estimate.

        Raises
        ------
        BagError
            No image in the window can be read.

        """
        started = time.perf_counter()
        try:
            self._calibrate(window)
            for message in self.bag.messages(self.topics.replayed, *window.log_times(self.bag)):
                decoded = self.bag.decode(message)
                if decoded is not None:
                    self._note(on_frame, self._dispatch.estimates(
                        self._role(message), decoded, message.log_ns
                    ))
            self._note(on_frame, self._dispatch.rest())
            self._complete = True
        except KeyboardInterrupt:
            self._complete = False
        self._seconds = time.perf_counter() - started
        if self._complete and not self.estimates:
            raise BagError(
                f'no image of {self.topics.image.name} can be read in the selected part of '
                'the bag; see --start and --duration' + ''.join(f'\n  {n}' for n in self.bag.notes)
            )

    def _calibrate(self, window: BagWindow) -> None:
        """Use the bag's first CameraInfo if it comes after the image or before the window."""
        start, stop = window.log_times(self.bag)
        image = next(self.bag.messages([self.topics.image.name], start, stop), None)
        for info in self.bag.messages([self.topics.camera_info.name]):
            decoded = self.bag.decode(info)
            if decoded is None:
                continue
            if image is not None and not start <= info.log_ns < image.log_ns:
                self._dispatch.take(CAMERA_INFO, decoded, info.log_ns)
                self._note_late_info(info.log_ns - image.log_ns)
            return

    def _note_late_info(self, late_ns: int) -> None:
        if late_ns > 0:
            self._notes.append(
                f'the first camera_info comes {late_ns * 1e-9:.3f} s after the first image and '
                'is used for the images before it too; the node would withhold their poses'
            )

    @property
    def complete(self) -> bool:
        """True if the bag was replayed to the end of the window."""
        return self._complete

    def result(self, title: str, sources: Mapping[str, Any], notes: list[str]) -> Run:
        """Return the run so far."""
        return Run(
            title=title, estimates=self.estimates, parameters=self.parameters, truth=self.truth,
            raster_map=self.raster_map, exhibits=self._worst.exhibits(),
            wall_seconds=self._seconds, complete=self._complete, sources=sources, wrong=self.wrong,
            notes=[*notes, *self._view(), *self._notes, *self.bag.notes, *self._unusable(),
                   *self._truth_elsewhere(), *self._withheld(),
                   *correction_notes(self.estimates, self.parameters)],
        )

    def _view(self) -> list[str]:
        """Return the view in words, if it is known."""
        text = self._dispatch.frontend.view.text
        return [text] if text else []

    def _role(self, raw: BagMessage) -> str:
        """Return the role of a message for the localizer."""
        named = {IMAGE: self.topics.image, MASK: self.topics.mask,
                 CAMERA_INFO: self.topics.camera_info, ODOMETRY: self.topics.odometry,
                 INITIAL_POSE: self.topics.initial_pose}
        return next(role for role, topic in named.items()
                    if topic is not None and topic.name == raw.topic)

    def _note(
        self, on_frame: Callable[[Estimate], None], found: Iterable[tuple[Frame, Estimate]]
    ) -> None:
        """Keep the data of a frame for the results."""
        compressed = self.topics.image.msgtype in COMPRESSED
        decode = compressed_grey_image if compressed else grey_image
        for frame, estimate in found:
            self._worst.add(partial(_or_none, decode, frame.message), estimate)
            for rule, detail in self._dispatch.frontend.warnings.items():
                times, first = self._warnings.get(rule, (0, detail))
                self._warnings[rule] = (times + 1, first)
            kept = replace(estimate, match=None)
            self.estimates.append(kept)
            on_frame(kept)

    def _unusable(self) -> list[str]:
        counts = self._dispatch.frontend.counts
        return [
            f'{topic}: {counts.get(f"{topic}_refused", 0)} of {counts.get(topic, 0)} '
            f'messages refused, first reason: {reason}'
            for topic, reason in self._dispatch.first_complaints.items()
        ] + [
            f'{rule} in {times} of {len(self.estimates)} frames, first: {detail}'
            for rule, (times, detail) in self._warnings.items()
        ] + ([f'{self._dispatch.overtaken} images were overtaken by a newer image with its mask']
             if self._dispatch.overtaken else [])

    def _truth_elsewhere(self) -> list[str]:
        """Return a note if the ground truth covers none of the images."""
        stamps = np.array([estimate.stamp_ns for estimate in self.estimates], np.int64)
        if self.truth is None or not len(stamps) or np.isfinite(self.truth.at(stamps)).any():
            return []
        spans = [f'{span.min() * 1e-9:.3f} to {span.max() * 1e-9:.3f} s'
                 for span in (self.truth.stamps_ns, stamps)]
        return [f'errors are unknown: the ground truth covers {spans[0]}, the images '
                f'{spans[1]}; expected stamps of one clock']

    def _withheld(self) -> list[str]:
        """Return one note for each status of frames without a pose, with the first reason."""
        first: dict[str, str] = {}
        for estimate in self.estimates:
            if not estimate.published:
                first.setdefault(str(estimate.status), desk_reason(estimate))
        times = Counter(str(estimate.status) for estimate in self.estimates)
        return [
            f'no pose, {word} in {times[word]} of {len(self.estimates)} frames, first: {reason}'
            for word, reason in first.items()
        ]


def _or_none(decode: Callable[[Any], Grey], message: Any) -> Grey | None:
    try:
        return decode(message)
    except ImageError:
        return None
