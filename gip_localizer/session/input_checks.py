# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Checks of well-formed inputs: repeated images, odometry with other stamps, wrong topics."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Grey
from gip_localizer.core.track.pose_filter import PoseFilter

ROW_STRIDE = 16
"""Step (rows) of a first quick comparison, which most pairs of images fail; chosen."""
LEAST_REPEATS = 3
"""Number of repetitions in a row from which they are reported; chosen."""
MOVED_XY, MOVED_YAW = 0.1, 0.02
"""Motion (m, rad) from which identical images prove a frozen camera; chosen above noise."""


class RepeatedImages:
    """
    Detects a camera that sends the same pixels with new stamps.

    Attributes
    ----------
    repeats : int
        Frames in a row whose pixels are those of the frame before.

    """

    def __init__(self) -> None:
        self.repeats = 0
        self._image: Grey | None = None
        self._first_ns = 0
        self._last_ns: int | None = None
        self._frozen = ''

    def frozen(self, stamp_ns: int, image: Grey, pose_filter: PoseFilter) -> str:
        """
        Return why the camera must be frozen; empty if it may work.

        Parameters
        ----------
        stamp_ns : int
            Of the image.
        image : (height, width) uint8, uint16 or float32
            Its pixels, which must not change until the next call.
        pose_filter : PoseFilter
            Predicts the motion of the vehicle.

        """
        if self._last_ns is not None and stamp_ns <= self._last_ns:
            self._image = None  # time went back or a stamp was repeated
        if self._image is None or not same_pixels(image, self._image):
            self.repeats, self._first_ns, self._frozen = 0, stamp_ns, ''
        else:
            self.repeats += 1
            self._frozen = self._frozen or self._contradiction(stamp_ns, pose_filter)
        self._image, self._last_ns = image, stamp_ns
        return self._frozen

    def _contradiction(self, stamp_ns: int, pose_filter: PoseFilter) -> str:
        moved = pose_filter.moved_since(self._first_ns, stamp_ns)
        if moved is None:
            return ''
        driven = math.hypot(moved.x, moved.y)
        if driven < MOVED_XY and abs(moved.yaw) < MOVED_YAW:
            return ''
        return (
            f'the pixels equal those of the previous frame although the vehicle moved '
            f'{driven:.2f} m and {moved.yaw:.3f} rad; check whether the camera is frozen'
        )


def same_pixels(first: Grey, second: Grey) -> bool:
    """Whether two images are identical to the bit."""
    return first.shape == second.shape and (
        np.array_equal(first[::ROW_STRIDE], second[::ROW_STRIDE]) and np.array_equal(first, second)
    )


def odometry_warnings(stamp_ns: int, pose_filter: PoseFilter) -> dict[str, str]:
    """Return the odometry rules that hold at an image, and their details."""
    found = {}
    apart = pose_filter.odometry.newest_ahead(stamp_ns)
    if apart is not None and pose_filter.odometry.pose_at(stamp_ns) is None:
        side = 'ahead of' if apart > 0.0 else 'behind'
        found['ODOMETRY_OFF_TIME'] = (
            f'the newest message is stamped {_span(abs(apart))} {side} the image; '
            'synchronize their clocks'
        )
    if pose_filter.odometry_check.rejected:
        found['ODOMETRY_CONTRADICTED'] = pose_filter.odometry_check.detail
    return found


def _span(seconds: float) -> str:
    return f'{seconds / 86400.0:.1f} days' if seconds > 86400.0 else f'{seconds:.3f} s'


def rectified_warning(topic: str, *, rectified: bool) -> str:
    """Return how a topic's name (of image_proc) contradicts `camera.rectified`, or empty."""
    name = topic.removesuffix('/compressed').removesuffix('/foxglove').rsplit('/', 1)[-1]
    if 'rect' in name.split('_') and not rectified:
        return (f'{topic} is named like rectified images, but camera.rectified is false: the '
                'distortion would be removed twice; set camera.rectified: true')
    if name == 'image_raw' and rectified:
        return (f'{topic} is named like raw images, but camera.rectified is true: the distortion '
                'would not be removed; set camera.rectified: false')
    return ''
