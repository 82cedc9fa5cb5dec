# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Build a map from a recorded drive with known poses, frame by frame, without a localizer."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from itertools import islice
import math
from typing import Any

import numpy as np

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.errors import BagError, GipError, ImageError, TrajectoryError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import Topics
from gip_localizer.io.image_stream import decoded_images
from gip_localizer.io.messages import stamp_ns
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.mapping.map_builder import MapBuilder
from gip_localizer.mapping.pose_pairs import Station
from gip_localizer.mapping.settings import MapBuilderSettings
from gip_localizer.mapping.splatting import draw, Drawn
from gip_localizer.mapping.survey_camera import SurveyCamera
from gip_localizer.mapping.tiles import overlap
from gip_localizer.mapping.vignetting import CommonCells, fit_vignetting
from gip_localizer.parameters import Parameters

LEAST_TURN = math.radians(0.5)
"""Least rotation between two mapped frames, rad, if the vehicle hardly moves; chosen."""
PAIRS = 24
"""Number of frame pairs, spread over the drive, for estimating the vignetting; chosen."""
PAIR_DISTANCE = 0.3
"""Distance between the two frames of a pair, as a fraction of the view's length; chosen."""
MISMATCH_SQ = 1e-3
"""Variance, in grey², by which cells of two frames differ beyond their noise; chosen."""
NO_POSE, NO_IMAGE, STATIONARY = 'without a pose', 'unreadable', 'hardly moved'
NO_CELL = 'cover no cell'


class _UnusedError(Exception):
    """A frame that is not used; its arguments are the kind of reason and a detail."""


class MappedDrive:
    """
    The construction of a map from a bag.

    Parameters
    ----------
    bag, topics : Bag, Topics
        Topics image and camera_info are read.
    parameters : Parameters
        Parameters for SurveyCamera.
    poses : Trajectory
        Poses of base_link in the map frame.
    settings : MapBuilderSettings
        Resolution, selection of frames and part of the bag.

    Attributes
    ----------
    builder, camera : MapBuilder, SurveyCamera
        The map as built so far, and the camera with its estimated vignetting.
    stations : list of Station
        Frames in the map.
    frames : int
        Number of examined frames.
    skipped, first : Counter, dict
        Kind of reason → number of unused frames, and the detail of the first one.

    """

    def __init__(self, bag: Bag, topics: Topics, parameters: Parameters, poses: Trajectory,
                 settings: MapBuilderSettings) -> None:
        self.builder = MapBuilder(settings.resolution)
        self.camera = SurveyCamera(bag, topics, parameters, settings.resolution)
        self.stations: list[Station] = []
        self.frames = 0
        self.skipped: Counter[str] = Counter()
        self.first: dict[str, str] = {}
        self._bag, self._topics, self._poses = bag, topics, poses
        self._settings = settings

    def run(self, on_frame: Callable[[], object]) -> RasterMap:
        """
        Read the bag twice, first for the vignetting, and return the map.

        Parameters
        ----------
        on_frame : callable
            Called after each frame.

        Raises
        ------
        GipError
            No frame can be used, or the map would become too large.

        """
        self.camera.vignetting = fit_vignetting(list(self._pairs()))
        last: Pose2 | None = None
        for message in self.messages():
            self.frames += 1
            try:
                last = self._add(message, last)
            except _UnusedError as unused:
                kind, found = unused.args
                self.skipped[kind] += 1
                self.first.setdefault(kind, found)
            on_frame()
        if self.builder.frames == 0:
            raise self._nothing_used()
        return self.builder.map()

    def messages(self) -> Iterator[Any]:
        """Yield the messages of the examined frames; None where a message does not decode."""
        times = self._settings.window.log_times(self._bag)
        messages = map(self._bag.decode, self._bag.messages([self._topics.image.name], *times))
        yield from islice(decoded_images(messages), 0, None, self._settings.every)

    def _add(self, message: Any | None, last: Pose2 | None) -> Pose2:
        """Add a frame and return its pose."""
        pose = self._pose(message)
        if last is not None and not self._moved(last, pose):
            raise _UnusedError(STATIONARY, _when(message))
        try:
            image = self.camera.image(message)
        except ImageError as error:
            raise _UnusedError(NO_IMAGE, str(error)) from None
        if not self.builder.add(*self.camera.view(image), pose):
            raise _UnusedError(NO_CELL, _when(message))
        self.stations.append(Station(stamp_ns(message.header), pose))  # type: ignore[union-attr]
        return pose

    def _pose(self, message: Any | None) -> Pose2:
        if message is None:
            raise _UnusedError(NO_IMAGE, 'does not decode')
        stamps = np.array([stamp_ns(message.header)], np.int64)
        gap_ns = round(self._settings.max_gap_s * 1e9)
        pose = Pose2(*self._poses.at(stamps, gap_ns)[0].tolist())
        if not pose.is_finite():
            raise _UnusedError(NO_POSE, _when(message))
        return pose

    def _moved(self, last: Pose2, pose: Pose2) -> bool:
        x, y, yaw = difference(pose, last)
        return math.hypot(x, y) >= self._settings.resolution or abs(yaw) >= LEAST_TURN

    def _pairs(self) -> Iterator[CommonCells]:
        """Yield the common cells of about `PAIRS` pairs of frames."""
        share = self._settings.window.share(self._bag) / self._settings.every
        count = self._topics.image.messages * share
        step, start = max(int(count / PAIRS), 1), 0
        begun: tuple[Pose2, Drawn] | None = None
        for number, message in enumerate(self.messages()):
            if begun is None and number < start:
                continue
            try:
                pose = self._pose(message)
                x, y, _ = difference(pose, begun[0]) if begun else (math.inf, 0.0, 0.0)
                if math.hypot(x, y) < PAIR_DISTANCE * self.camera.length:
                    continue
                drawn = self._drawn(message, pose)
            except (_UnusedError, ImageError):
                continue
            if begun is None:
                begun, start = (pose, drawn), number + step
            else:
                yield _common_cells(begun[1], drawn)
                begun = None

    def _drawn(self, message: Any, pose: Pose2) -> Drawn:
        """Draw a frame on map cells: its grey, and the squared radii in its image."""
        view, weight = self.camera.view(self.camera.image(message))
        layers = (view.patch, self.camera.radius_sq)
        return draw(layers, weight, view.grid, pose, self._settings.resolution)

    def _nothing_used(self) -> GipError:
        """Return the error for a drive without any used frame."""
        name = self._topics.image.name
        if self.frames == 0:
            return BagError(f'no image of {name} lies in the selected part of the bag; see '
                            '--start and --duration')
        if self.skipped[NO_POSE]:
            span = self._poses.stamps_ns[[0, -1]] * 1e-9
            return TrajectoryError(
                f'no pose for any image: the poses are from {span[0]:.3f} to {span[1]:.3f} s, the '
                f'first image without one {self.first[NO_POSE]}; expected stamps of one clock '
                f'that are at most {self._settings.max_gap_s:g} s apart (--max-gap)'
            )
        kind = next(iter(self.skipped))
        return BagError(f'none of {self.frames} images of {name} can be used, the first is '
                        f'{kind}: {self.first[kind]}')


def _common_cells(one: Drawn, other: Drawn) -> CommonCells:
    here, there = overlap(one.box, other.box)
    weights = one.weight[here], other.weight[there]
    both = (weights[0] > 0.0) & (weights[1] > 0.0)
    weight = 1.0 / (1.0 / weights[0][both] + 1.0 / weights[1][both] + MISMATCH_SQ)
    (value, radius_sq), (later, later_radius_sq) = (
        drawn.layers[(slice(None), *part)][:, both]
        for drawn, part in ((one, here), (other, there))
    )
    return CommonCells((value, later), (radius_sq, later_radius_sq), weight)


def _when(message: Any) -> str:
    return f'at {stamp_ns(message.header) * 1e-9:.3f} s'
