# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The squares that the camera sees completely, by a rule that gives the paper's 66 squares.

The paper does not state the rule; this one reproduces the widths of Fig. SimRoadPlane (5, 5, 7, 7,
9, 9, 11, 13) from the camera's parameters. Rows lie at whole multiples of the side within the
vertical field of view. A row holds the largest odd number of squares that fits within
`± √(d² + h²) tan(fov/2)`, where d is the ground distance of its near edge.

"""

from __future__ import annotations

from dataclasses import dataclass
import math

import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Floats
from gip_localizer.errors import ParameterError
from gip_localizer.paper.geometry import depth_of_distance, PaperCamera
from gip_localizer.paper.theory import gramian

SLACK = 1e-4
"""Tolerance, as a fraction of a side: the printed parameters have six digits."""
MAX_SQUARES = 2000
"""Largest number of squares, which bounds time and memory; chosen."""


@dataclass(frozen=True, eq=False)
class Squares:
    """
    Rows of squares, from near to far.

    Attributes
    ----------
    distances : (rows,) float64
        Ground distance of each row's near edge, cm.
    counts : (rows,) int64
        Number of squares in each row.
    row_gramian : (rows,) float64
        G_kk of a square of each row, 1/cm.

    """

    distances: Floats
    counts: NDArray[np.int64]
    row_gramian: Floats

    @property
    def total(self) -> int:
        """Number of squares."""
        return int(self.counts.sum())

    @property
    def gramian(self) -> Floats:
        """Diagonal of the Gramian, one entry per square, (total,)."""
        return np.repeat(self.row_gramian, self.counts)


def seen_distances(camera: PaperCamera) -> tuple[float, float]:
    """
    Return the ground distances within the vertical field of view, cm: `h / tan(θ ± fov/2)`.

    Raises
    ------
    ParameterError
        The upper edge of the view is at or above the horizon, so there is no last row.

    """
    half = 0.5 * math.radians(camera.fov_vertical_deg)
    if camera.theta - half <= 0.0:
        raise ParameterError(
            f'the view reaches the horizon (pitch {camera.pitch_deg:g}°, vertical field of view '
            f'{camera.fov_vertical_deg:g}°): raise --pitch above half of --fov-vertical'
        )
    near = camera.height / math.tan(camera.theta + half)
    return near, camera.height / math.tan(camera.theta - half)


def visible_squares(camera: PaperCamera) -> Squares:
    """
    Return the squares that the camera sees completely.

    Raises
    ------
    ParameterError
        There is no square, or there are more than `MAX_SQUARES`.

    """
    near, far = seen_distances(camera)
    first = math.ceil(near / camera.square - SLACK)
    last = math.floor(far / camera.square + SLACK)
    if last - first > MAX_SQUARES:
        raise _too_many(last - first, 'rows of squares')
    distances = camera.square * np.arange(first, max(last, first), dtype=float)
    counts = _row_counts(camera, distances)
    seen = counts > 0
    if not seen.any():
        raise ParameterError(
            f'the camera sees no whole square of {camera.square:g} cm between {near:.4g} and '
            f'{far:.4g} cm ahead: reduce --square or widen the field of view'
        )
    if counts.sum() > MAX_SQUARES:
        raise _too_many(int(counts.sum()), 'squares')
    distances, counts = distances[seen], counts[seen]
    z_near = depth_of_distance(camera, distances)
    z_far = depth_of_distance(camera, distances + camera.square)
    width = np.full(len(distances), camera.square)
    return Squares(distances, counts, gramian(width, z_near, z_far))


def _too_many(count: int, what: str) -> ParameterError:
    return ParameterError(
        f'the view holds {count} {what}, more than {MAX_SQUARES}: enlarge --square or narrow the '
        'field of view'
    )


def _row_counts(camera: PaperCamera, distances: Floats) -> NDArray[np.int64]:
    """Return the largest odd number of squares per row within the horizontal field of view."""
    half_angle = 0.5 * math.radians(camera.fov_horizontal_deg)
    width = 2.0 * np.hypot(distances, camera.height) * math.tan(half_angle)
    whole = np.floor(width / camera.square + SLACK).astype(np.int64)
    return np.where(whole % 2 == 1, whole, np.maximum(whole - 1, 0))
