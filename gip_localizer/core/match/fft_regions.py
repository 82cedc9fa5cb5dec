# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Which cells of the canvas the turned weight touches, so that no more is transformed.

A camera's view has empty corners, and a part of the yaws needs less room than all of them.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np

from gip_localizer.core.arrays import Floats

CUTS = ((0, 1), (0, 1 / 2, 1), (0, 1 / 3, 2 / 3, 1), (0, 1 / 4, 3 / 4, 1), (0, 1 / 6, 5 / 6, 1),
        (0, 1 / 8, 1 / 4, 3 / 4, 7 / 8, 1))
"""Divisions of the yaws into groups, as shares of all (design choice: coarser in the middle)."""
# Least number of yaws of a group (design choice: 6, because a group has transforms of its own).
YAWS_OF_A_GROUP = 6
# Number of transforms per yaw: three for every two yaws, as two real planes share one transform.
TRANSFORMS_PER_YAW = 1.5


@dataclass(frozen=True)
class Part:
    """Some yaws, and the rows and columns of the canvas that they touch."""

    yaws: range
    rows: slice
    cols: slice

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.rows.stop - self.rows.start, self.cols.stop - self.cols.start


def make_parts(
    weight: Floats, affines: Sequence[Floats], canvas: tuple[int, int],
    translations: tuple[int, int], fields: int, cost_of: Callable[[int, int], float],
) -> list[Part]:
    """
    Divide the yaws so that their transforms cost least.

    Parameters
    ----------
    weight : (rows, cols) float32
        Where it is 0, the templates are.
    affines : sequence of (2, 3)
        `turn_affine` of every yaw.
    canvas : (int, int)
        Its rows and columns.
    translations : (int, int)
        In x (rows) and y (columns).
    fields : int
        Fields that each part transforms.
    cost_of : callable
        Of one transform of so many rows and columns.

    """
    boxes = _boxes(weight, affines, canvas)

    def cost(parts: list[Part]) -> float:
        return sum(
            (TRANSFORMS_PER_YAW * len(part.yaws) + fields)
            * cost_of(*(n + more - 1 for n, more in zip(part.shape, translations, strict=True)))
            for part in parts
        )

    few = len(affines) < 2 * YAWS_OF_A_GROUP
    divided = [_divided(boxes, shares) for shares in (CUTS[:1] if few else CUTS)]
    return min((d for d in divided if few or _all_large(d)), key=cost)


def _all_large(parts: list[Part]) -> bool:
    return min(len(part.yaws) for part in parts) >= YAWS_OF_A_GROUP


def _divided(boxes: Floats, shares: Sequence[float]) -> list[Part]:
    parts = []
    for start, stop in pairwise(round(share * len(boxes)) for share in shares):
        low, high = boxes[start:stop, 0].min(axis=0), boxes[start:stop, 1].max(axis=0)
        parts.append(Part(range(start, stop), slice(int(low[1]), int(high[1])),
                          slice(int(low[0]), int(high[0]))))
    return parts


def _boxes(weight: Floats, affines: Sequence[Floats], canvas: tuple[int, int]) -> Floats:
    """First and one past the last (column, row) of the canvas that each yaw touches, (n, 2, 2)."""
    hull = _hull(weight)
    size = np.array([canvas[1], canvas[0]])
    if not len(hull):
        return np.tile(np.array([[0, 0], [1, 1]]), (len(affines), 1, 1))
    there = np.array(affines)
    back = np.linalg.inv(there[:, :, :2])
    turned = (hull[None] - there[:, None, :, 2]) @ back.transpose(0, 2, 1)
    low = np.clip(np.floor(turned.min(axis=1) + 1e-6) + 1, 0, size - 1)
    high = np.clip(np.ceil(turned.max(axis=1) - 1e-6), low + 1, size)
    return np.stack([low, high], axis=1).astype(np.int64)


def _hull(weight: Floats) -> Floats:
    """Corners (n, 2), columns and rows, of the convex hull of what bilinear sampling touches."""
    mask = weight > 0.0
    rows = np.flatnonzero(mask.any(axis=1))
    first = mask[rows].argmax(axis=1) - 1.0
    last = mask.shape[1] - mask[rows, ::-1].argmax(axis=1)
    points = np.concatenate([
        np.stack([cols, rows + side], axis=1) for cols in (first, last) for side in (-1.0, 1.0)
    ])
    if not len(points):
        return points
    return np.asarray(cv2.convexHull(points.astype(np.float32))[:, 0], np.float64)
