# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the worst frames, collected during a run."""

from __future__ import annotations

from collections.abc import Callable
import heapq
import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Bools
from gip_localizer.core.estimate import Estimate
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import map_window
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.evaluation.run import FrameExhibit
from gip_localizer.io.trajectory import Trajectory
from gip_localizer.visualization.match_images import Picture, stretched

UNKNOWN = 235
"""Grey, 0 to 255, of cells that were not seen or are not on the map; chosen."""


def frame_exhibit(title: str, image: NDArray[Any] | None, estimate: Estimate,
                  raster_map: RasterMap) -> FrameExhibit:
    """
    Return the pictures of one frame, for all stages that its match reached.

    Parameters
    ----------
    title : str
        Heading of the pictures.
    image : (height, width) array or None
        Grey camera image.
    estimate : Estimate
        Estimate with its `match`.
    raster_map : RasterMap
        Map from which the matched window is cut.

    """
    pictures: dict[str, NDArray[Any]] = {}
    if image is not None:
        pictures['camera image'] = stretched(np.asarray(image, np.float32), np.isfinite(image))
    match = estimate.match
    if match is None:
        return FrameExhibit(title, estimate.stamp_ns, pictures)
    view = match.view
    pictures['bird\'s-eye view'] = _picture(view.patch, view.valid)
    pose = _matched_pose(estimate)
    if pose is not None:
        window, known = map_window(raster_map, view.grid, pose)
        pictures['matched map window'] = _picture(window, view.valid & (known > 0.0))
    if match.scores is not None:
        best = match.scores.best()[0]
        pictures['score surface (ahead is up)'] = np.asarray(
            match.scores.correlation[best], np.float64
        )
    return FrameExhibit(title, estimate.stamp_ns, pictures)


def _matched_pose(estimate: Estimate) -> Pose2 | None:
    match = estimate.match
    if match is not None and match.fit is not None:
        return match.fit.pose
    if match is not None and match.scores is not None:
        return match.scores.lattice.pose(np.array(match.scores.best(), np.float64))
    return estimate.pose


def _picture(values: NDArray[Any], valid: Bools) -> Picture:
    """Return grey stretched where it is valid; other cells are light."""
    return np.where(valid, stretched(values, valid), UNKNOWN).astype(np.uint8)


class WorstFrames:
    """
    Keeps the pictures of the worst frames so far.

    Published frames are ranked by their error or, without ground truth, by their reported σ.
    Withheld frames rank behind all published ones.

    Parameters
    ----------
    truth : Trajectory or None
        Ground truth.
    raster_map : RasterMap
        Map for the matched windows.
    count : int
        Number of frames to keep.

    """

    def __init__(self, truth: Trajectory | None, raster_map: RasterMap, count: int = 5) -> None:
        self._truth = truth
        self._map = raster_map
        self._count = count
        self._heap: list[tuple[float, int, FrameExhibit]] = []
        self._seen = 0
        self._start_ns: int | None = None

    def add(self, image: Callable[[], NDArray[Any] | None], estimate: Estimate) -> None:
        """Add a frame if it is among the worst; `image` is called only then."""
        self._seen += 1
        if self._start_ns is None:
            self._start_ns = estimate.stamp_ns
        badness, words = self._judge(estimate)
        if len(self._heap) == self._count and badness <= self._heap[0][0]:
            return
        seconds = (estimate.stamp_ns - self._start_ns) * 1e-9
        title = f'Frame {self._seen}, {seconds:.2f} s: {words}'
        entry = (badness, self._seen, frame_exhibit(title, image(), estimate, self._map))
        if len(self._heap) < self._count:
            heapq.heappush(self._heap, entry)
        else:
            heapq.heapreplace(self._heap, entry)

    def exhibits(self) -> list[FrameExhibit]:
        """Return the kept frames, the worst first."""
        return [exhibit for _, _, exhibit in sorted(self._heap, key=lambda e: (-e[0], e[1]))]

    def _judge(self, estimate: Estimate) -> tuple[float, str]:
        if estimate.pose is None:
            return -1.0, f'{estimate.status}, {estimate.reason}'.rstrip(', ')
        if self._truth is not None:
            true = self._truth.at(np.array([estimate.stamp_ns]))[0]
            if np.isfinite(true).all():
                error = difference(estimate.pose, Pose2(*(float(v) for v in true)))
                off = math.hypot(error[0], error[1])
                return off, f'error {1e3 * off:.1f} mm, {math.degrees(error[2]):+.3f} deg'
        if estimate.covariance is None:
            return 0.0, 'covariance unknown'
        sigma = math.sqrt(max(float(np.trace(estimate.covariance[:2, :2])), 0.0))
        return sigma * 1e-3, f'reported sigma {1e3 * sigma:.1f} mm'
