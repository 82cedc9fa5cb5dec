# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Compare the poses of a mapped drive with what its own frames see."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.errors import ImageError, MapError
from gip_localizer.io.messages import stamp_ns
from gip_localizer.mapping.map_builder import MapBuilder
from gip_localizer.mapping.mapped_drive import MappedDrive
from gip_localizer.mapping.pose_errors import estimate_pose_errors, Pair, PoseErrors
from gip_localizer.mapping.pose_pairs import choose_pairs, driven_distances, Station
from gip_localizer.parameters import Parameters

START_SIGMAS = np.array([0.15, 0.15, 0.015])
"""Standard deviations of the start of a comparison: m, m, rad; chosen: poses that are worse
than this blur a map beyond use."""
STEP_NS = 1_000_000_000
"""Time between two comparisons for the localizer, ns; chosen: each begins from its own start."""
LEAST_OVERLAP = 0.2
"""Least share of the view that both frames see; chosen: the confidence judges what it gives."""
LEAST_PAIRS = 4
"""Least number of comparisons for an estimate; chosen."""


class PoseCheckResult(NamedTuple):
    """
    Result of the comparison.

    Attributes
    ----------
    pairs : list of Pair
        Pairs of frames that could be compared.
    tried : int
        Number of pairs that were tried.
    errors : PoseErrors or None
        Estimated errors of the poses; None if too few pairs could be compared.

    """

    pairs: list[Pair]
    tried: int
    errors: PoseErrors | None


class PoseCheck:
    """
    Localizes frames of a drive on maps of single other frames, and compares with the given poses.

    Parameters
    ----------
    drive : MappedDrive
        A drive after `run`.
    parameters : Parameters
        Parameters of the drive.
    resolution : float
        Side of a map cell, metres.

    Attributes
    ----------
    indices : list of (int, int)
        Pairs of mapped frames that will be compared.

    """

    def __init__(self, drive: MappedDrive, parameters: Parameters, resolution: float) -> None:
        self._drive, self._resolution = drive, resolution
        self._stations = drive.stations
        self.indices = choose_pairs(self._stations, drive.camera.length)
        self._parameters = _comparing(parameters, drive)
        self._localizer: Localizer | None = None
        self._comparisons = 0

    def run(self, on_pair: Callable[[], object]) -> PoseCheckResult:
        """Compare all pairs, calling `on_pair` after each; deterministic."""
        driven = driven_distances(self._stations)
        images = self._images()
        pairs: list[Pair] = []
        for earlier, later in self.indices:
            one, other = self._stations[earlier], self._stations[later]
            if one.stamp_ns in images and other.stamp_ns in images:
                found = self._compared(one, other, images)
                if found is not None:
                    pairs.append(Pair(
                        stamps_ns=(one.stamp_ns, other.stamp_ns),
                        driven=(float(driven[earlier]), float(driven[later])),
                        lever=(one.pose.x - other.pose.x, one.pose.y - other.pose.y),
                        disagreement=found[0], covariance=found[1],
                    ))
            on_pair()
        errors = None
        if len(pairs) >= LEAST_PAIRS:
            errors = estimate_pose_errors(pairs, self._resolution)
        return PoseCheckResult(pairs, len(self.indices), errors)

    def _images(self) -> dict[int, Grey]:
        """Return the images of all frames of the pairs by stamp."""
        stations = self._stations
        wanted = {stations[k].stamp_ns for pair in self.indices for k in pair}
        images: dict[int, Grey] = {}
        for message in self._drive.messages():
            stamp = None if message is None else stamp_ns(message.header)
            if stamp in wanted:
                image = self._image(message)
                if image is not None:
                    images[stamp] = image
        return images

    def _image(self, message: Any) -> Grey | None:
        try:
            return self._drive.camera.image(message)
        except ImageError:
            return None

    def _compared(
        self, one: Station, other: Station, images: dict[int, Grey]
    ) -> tuple[Any, Any] | None:
        """Return the earlier frame's disagreement (3,) and covariance (3, 3), map axes."""
        raster_map = self._map_of(images[other.stamp_ns], other.pose)
        if raster_map is None:
            return None
        if self._localizer is None:
            self._localizer = Localizer(raster_map, self._parameters)
        self._localizer.change_map(raster_map)
        self._comparisons += 1
        stamp = self._comparisons * STEP_NS
        self._localizer.set_prior(stamp, one.pose, np.diag(START_SIGMAS**2))
        camera = self._drive.camera
        estimate = self._localizer.update(
            stamp, images[one.stamp_ns], camera.model, mask=camera.mask
        )
        if estimate.pose is None or estimate.covariance is None:
            return None
        return difference(estimate.pose, one.pose), estimate.covariance

    def _map_of(self, image: Grey, pose: Pose2) -> RasterMap | None:
        builder = MapBuilder(self._resolution)
        try:
            return builder.map() if builder.add(*self._drive.camera.view(image), pose) else None
        except MapError:
            return None


def _comparing(parameters: Parameters, drive: MappedDrive) -> Parameters:
    """Return parameters for single frames whose mounting and map have no errors in common."""
    view = {f'birdseye.{name}': value for name, value in vars(drive.camera.birdseye).items()}
    return parameters.replace({
        **view, 'motion.fuse': False, 'camera.sigma_yaw': 0.0, 'map.sigma_xy': 0.0,
        'map.sigma_yaw': 0.0, 'score.min_overlap': LEAST_OVERLAP,
    })
