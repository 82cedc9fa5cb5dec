# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Other vehicles in the view: boxes on the road, projected through the lens, with a soft shadow.

They are seen by the camera and missing in the map. Outlines are clipped in front of the camera
and subdivided, so that a distorting lens bends them. Their sizes (metres) and reflectances are
chosen like those of passenger cars.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.pose import Pose2

Floats = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Bools = NDArray[np.bool_]

REACH = 25.0
"""Distance, in metres, up to which road counts for the hidden share; chosen."""
_SHIFT = 4
"""Fractional bits of the vertices that OpenCV draws: positions are exact to 1/16 px."""
_NEAREST = 0.3
"""Depth in front of the camera, in metres, at which outlines are clipped; chosen."""
_MOST_CARS = 12
"""Largest number of cars in view; chosen."""
_PIECES = 12
"""Number of pieces into which an edge is divided before projection; chosen."""


@dataclass(frozen=True)
class Car:
    """
    A box on the road.

    Attributes
    ----------
    pose : Pose2
        Its centre, in the base frame of the vehicle that carries the camera.
    length, width, height : float
        Metres.
    grey : float
        Reflectance of its paint.

    """

    pose: Pose2
    length: float = 4.4
    width: float = 1.8
    height: float = 1.5
    grey: float = 0.4


def draw_cars(image: Floats32, camera: CameraModel, cars: Sequence[Car]) -> Bools:
    """
    Draw cars over an image, in place, the farthest first.

    Parameters
    ----------
    image : (height, width) float32
        Scene brightness.
    camera : CameraModel
        The camera with its mounting pose in this frame.
    cars : sequence of Car
        In the base frame.

    Returns
    -------
    (height, width) bool
        True where a car hides the road (its shadow does not count).

    """
    hidden = np.zeros(image.shape, np.uint8)
    for car in sorted(cars, key=lambda c: -float(np.hypot(c.pose.x, c.pose.y))):
        for swell, dark in ((0.5, 0.25), (0.3, 0.3), (0.12, 0.4)):
            _fill(image, camera, _footprint(car, swell, 0.0), 0.03, dark)
        for face, shade in _faces(car, camera):
            mask = _fill(image, camera, face, shade, 1.0)
            np.maximum(hidden, mask, out=hidden)
    return np.asarray(hidden > 127)


def hidden_share(camera: CameraModel, cars: Sequence[Car], reach: float = REACH) -> float:
    """Return the fraction hidden by cars, of the pixels that see road within `reach` metres."""
    small = _thumbnail(camera)
    return _share(small, _road(small, reach), cars)


def cars_hiding(
    camera: CameraModel, share: float, rng: np.random.Generator, tries: int = 12
) -> list[Car]:
    """
    Return random traffic that hides about the given fraction of the visible road.

    Cars are added ahead and in the neighbouring lanes until the fraction is reached. Of several
    random arrangements the one nearest to the fraction is returned.

    """
    small = _thumbnail(camera)
    road = _road(small, REACH)
    best: list[Car] = []
    miss = share
    for _ in range(tries):
        cars: list[Car] = []
        hides = 0.0
        while len(cars) < _MOST_CARS and hides < share - 0.02:
            cars.append(_random_car(rng))
            hides = _share(small, road, cars)
        if abs(hides - share) < miss:
            best, miss = cars, abs(hides - share)
        if miss < 0.02:
            break
    return best


def _thumbnail(camera: CameraModel) -> CameraModel:
    """Return the camera with binned pixels, its image about 160 px wide."""
    join = max(1, camera.width // 160)
    x, y = camera.calibration.binning
    calibration = replace(camera.calibration, binning=(x * join, y * join))
    return CameraModel(calibration, camera.extrinsics, rectified=camera.rectified)


def _road(camera: CameraModel, reach: float) -> Bools:
    """Return the pixels (height, width) that see road within `reach` metres of base."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    xy, valid = camera.road_points(np.column_stack([u.ravel(), v.ravel()]).astype(float))
    near = np.linalg.norm(np.where(valid[:, None], xy, np.inf), axis=1) < reach
    return np.asarray(near.reshape(camera.height, camera.width))


def _share(camera: CameraModel, road: Bools, cars: Sequence[Car]) -> float:
    hidden = draw_cars(np.zeros(road.shape, np.float32), camera, cars)
    return float(hidden[road].sum() / max(int(road.sum()), 1))


def _random_car(rng: np.random.Generator) -> Car:
    lane = float(rng.choice([-3.3, 0.0, 3.3])) + float(rng.normal(0.0, 0.25))
    nearest = 6.0 if abs(lane) < 1.8 else 2.0
    pose = Pose2(float(rng.uniform(nearest, 16.0)), lane, float(rng.normal(0.0, 0.06)))
    return Car(pose, float(rng.uniform(3.8, 5.2)), float(rng.uniform(1.7, 2.0)),
               float(rng.uniform(1.4, 2.1)), float(rng.choice([0.08, 0.2, 0.45, 0.75])))


def _footprint(car: Car, swell: float, height: float) -> Floats:
    """Return the box's outline at a height, enlarged by `swell` metres, (4, 3) in base."""
    half = np.array([car.length / 2 + swell, car.width / 2 + swell])
    corners = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]) * half
    return np.column_stack([car.pose.transform(corners), np.full(4, height)])


def _faces(car: Car, camera: CameraModel) -> list[tuple[Floats, float]]:
    """Return the faces that the camera can see and their brightness, the farthest first."""
    low, high = _footprint(car, 0.0, 0.15), _footprint(car, 0.0, car.height)
    eye = camera.extrinsics.position()
    faces = []
    for i, shade in enumerate((0.85, 0.6, 0.85, 0.75)):
        j = (i + 1) % 4
        corners = np.array([low[i], low[j], high[j], high[i]])
        outward = corners[:2].mean(axis=0)[:2] - np.array([car.pose.x, car.pose.y])
        if np.dot(outward, eye[:2] - corners[:2].mean(axis=0)[:2]) > 0.0:
            faces.append((corners, shade * car.grey))
            faces.append((_window(corners), 0.08))
    if eye[2] > car.height:
        faces.append((high, 0.95 * car.grey))
    return faces


def _window(face: Floats) -> Floats:
    """Return the window in the upper part of a side, (4, 3)."""
    bottom = face[[0, 1]] + 0.6 * (face[[3, 2]] - face[[0, 1]])
    top = face[[0, 1]] + 0.92 * (face[[3, 2]] - face[[0, 1]])
    inset = 0.1 * (bottom[1] - bottom[0])
    return np.array([bottom[0] + inset, bottom[1] - inset, top[1] - inset, top[0] + inset])


def _fill(
    image: Floats32, camera: CameraModel, outline: Floats, value: float, alpha: float
) -> NDArray[np.uint8]:
    """Blend a value into a projected outline, in place; return its coverage, 0 to 255."""
    mask = np.zeros(image.shape, np.uint8)
    points = _in_front(_subdivided(outline), camera)
    if len(points) < 3:
        return mask
    uv, valid = camera.project(points)
    vertices = np.clip(uv[valid], -8000.0, 8000.0)
    if len(vertices) < 3:
        return mask
    fixed = np.rint(vertices * (1 << _SHIFT)).astype(np.int32)
    cv2.fillPoly(mask, [fixed], 255, cv2.LINE_AA, _SHIFT)
    x, y, width, height = cv2.boundingRect(mask)
    part = (slice(y, y + height), slice(x, x + width))
    image[part] += mask[part] * np.float32(alpha / 255.0) * (np.float32(value) - image[part])
    return mask


def _subdivided(outline: Floats) -> Floats:
    """Return a closed outline (n, 3) with every edge divided into `_PIECES`."""
    shares = np.arange(_PIECES)[:, None] / _PIECES
    ends = np.roll(outline, -1, axis=0)
    edges = zip(outline, ends, strict=True)
    return np.concatenate([a + shares * (b - a) for a, b in edges])


def _in_front(points: Floats, camera: CameraModel) -> Floats:
    """Return the closed outline (n, 3), clipped at depth `_NEAREST`."""
    depth = (points - camera.extrinsics.position()) @ camera.R_base_camera[:, 2] - _NEAREST
    kept: list[Floats] = []
    for i in range(len(points)):
        a, b, da, db = points[i - 1], points[i], depth[i - 1], depth[i]
        if (da > 0.0) != (db > 0.0):
            kept.append(a + (da / (da - db)) * (b - a))
        if db > 0.0:
            kept.append(b)
    return np.array(kept).reshape(-1, 3)
