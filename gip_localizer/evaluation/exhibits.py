# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The pictures of one frame for the report."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Bools
from gip_localizer.core.estimate import Estimate
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import map_window
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.run import FrameExhibit, Surface
from gip_localizer.visualization.match_images import painted, Picture, stretched

UNSEEN = 'dark blue: not seen, or not on the map'


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
    pictures: dict[str, NDArray[Any] | Surface] = {}
    if image is not None:
        pictures['camera image'] = stretched(np.asarray(image, np.float32), np.isfinite(image))
    match = estimate.match
    if match is None:
        return FrameExhibit(title, estimate.stamp_ns, pictures)
    view = match.view
    pictures['bird\'s-eye view, ahead is up'] = _picture(view.patch, view.valid)
    pose = _matched_pose(estimate)
    if pose is not None:
        window, known = map_window(raster_map, view.grid, pose)
        caption = f'map at the matched pose ({UNSEEN})'
        pictures[caption] = _picture(window, view.valid & (known > 0.0))
    if match.scores is not None:
        surface = _surface(match.scores)
        pictures[f'scores at the best heading, {surface.heading_deg:+.2f} deg from the centre of '
                 'the window'] = surface
    return FrameExhibit(title, estimate.stamp_ns, pictures)


def _surface(scores: Scores) -> Surface:
    """Return the correlation over the offsets at the best heading."""
    best, lattice = scores.best()[0], scores.lattice
    ahead, left = ((half + 0.5) * lattice.step for half in lattice.half)
    return Surface(np.asarray(scores.correlation[best], np.float64), ahead, left,
                   math.degrees(float(lattice.yaws[best])))


def _matched_pose(estimate: Estimate) -> Pose2 | None:
    match = estimate.match
    if match is not None and match.fit is not None:
        return match.fit.pose
    if match is not None and match.scores is not None:
        return match.scores.lattice.pose(np.array(match.scores.best(), np.float64))
    return estimate.pose


def _picture(values: NDArray[Any], valid: Bools) -> Picture:
    """Return grey as RGB, stretched where it is valid; other cells are dark blue."""
    return painted(np.dstack([stretched(values, valid)] * 3), valid)[..., ::-1]
