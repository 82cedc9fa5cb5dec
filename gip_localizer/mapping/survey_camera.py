# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera of a bag for mapping: images to views and weights, corrected for vignetting."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from gip_localizer.core.arrays import Bools, Floats, Grey
from gip_localizer.core.birdseye.pixel_noise import estimate_pixel_noise
from gip_localizer.core.birdseye.rectifier import Rectifier, View
from gip_localizer.core.birdseye.view_choice import complete_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.gramian import gramian
from gip_localizer.errors import CalibrationError, ImageError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.camera import recorded_camera
from gip_localizer.io.bags.topics import IMAGES, Topics
from gip_localizer.io.bit_depth import BitDepth
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.io.map_files import load_mask
from gip_localizer.mapping.vignetting import Vignetting
from gip_localizer.parameters import Parameters
from gip_localizer.session.masks import fitting

FINER = 2
"""View cells along a side of a map cell, which keeps edges sharp; chosen."""
LONGEST_PIXEL = 2.0
"""Largest footprint length of a pixel, in map cells; longer ones blur the map; chosen."""
STEP = 1e-3
"""Step of numerical derivatives, metres; chosen."""


class SurveyCamera:
    """
    The camera of a bag, for mapping.

    Parameters
    ----------
    bag, topics : Bag, Topics
        The first readable camera_info is used.
    parameters : Parameters
        `camera.*`, `birdseye.*`, `mask_file` and `score.pixel_noise`.
    resolution : float
        Side of a map cell, metres; views have cells of half this size.

    Attributes
    ----------
    model : CameraModel
        The calibrated camera.
    birdseye : Birdseye
        The view, on cells of the map's size.
    mask : (height, width) uint8 or None
        Pixels below 128 show the own vehicle.
    vignetting : Vignetting
        Correction applied to every view; none at first.
    radius_sq : (rows, cols) float64
        Squared distance of the view's cells from the principal point in the image, in units of
        half the image diagonal.

    Raises
    ------
    GipError
        There is no usable camera_info, the view sees no road, or the mask cannot be read.

    """

    def __init__(self, bag: Bag, topics: Topics, parameters: Parameters,
                 resolution: float) -> None:
        self.model = recorded_camera(bag, topics, parameters)
        self._depth = BitDepth()
        self._compressed = topics.image.msgtype in IMAGES[1:]
        self._noise = parameters.score.pixel_noise
        self.mask = load_mask(parameters.mask_file) if parameters.mask_file else None
        self.birdseye = complete_view(
            replace(parameters.birdseye, resolution=resolution), self.model
        )
        finer = replace(self.birdseye, resolution=resolution / FINER)
        self._rectifier = Rectifier(self.model, finer)
        longest = LONGEST_PIXEL * resolution
        self._used = self._rectifier.valid & sharp(self.model, self._rectifier, longest)
        if not self._used.any():
            raise CalibrationError(
                f'every pixel of the view spans more than {longest:g} m of road; choose a coarser '
                '--resolution or a nearer birdseye.near'
            )
        self.vignetting = Vignetting()
        self.radius_sq = _radius_sq(self.model, self._rectifier)

    @property
    def length(self) -> float:
        """Length of the used part of the view, metres ahead."""
        rows = np.flatnonzero(self._used.any(axis=1))
        return float(rows[-1] - rows[0] + 1) * self._rectifier.grid.resolution

    @property
    def farthest(self) -> tuple[float, float]:
        """Farthest road that is used, and that the camera sees in the view, metres ahead."""
        grid = self._rectifier.grid
        used, seen = (grid.far - int(np.flatnonzero(cells.any(axis=1))[0]) * grid.resolution
                      for cells in (self._used, self._rectifier.valid))
        return used, seen

    def image(self, message: Any) -> Grey:
        """Return the image (height, width) of a message (raises ImageError)."""
        image = compressed_grey_image(message) if self._compressed else grey_image(message)
        (height, width), camera = image.shape, self.model
        if (width, height) != (camera.width, camera.height):
            raise ImageError(
                f'the image is {width}x{height}, its CameraInfo is for '
                f'{camera.width}x{camera.height}'
            )
        fitting(self.mask, image)
        return self._depth.scaled(image)

    def view(self, image: Grey) -> tuple[View, Floats]:
        """Return the view of an image, corrected for vignetting, and its weights (rows, cols)."""
        view = self._rectifier.rectify(image)
        noise = self._noise or estimate_pixel_noise(image)
        weight = gramian(view.footprint, pixel_noise=noise, map_noise=0.0) * self._used
        if self.mask is not None:
            weight = weight * self._rectifier.unmasked(self.mask)
        lift = self.vignetting.lift(self.radius_sq).astype(np.float32)
        return replace(view, patch=view.patch * lift), weight / lift**2


def sharp(camera: CameraModel, rectifier: Rectifier, longest: float) -> Bools:
    """Return True for view cells (rows, cols) whose pixels are at most `longest` metres long."""
    points = rectifier.grid.points()
    per_metre = [
        (camera.project(points + shift)[0] - camera.project(points - shift)[0]) / (2.0 * STEP)
        for shift in np.eye(2) * STEP
    ]
    pixels = np.nan_to_num(np.stack(per_metre, axis=-1))  # (n, 2, 2): px per metre along x, y
    least = np.linalg.svd(pixels, compute_uv=False)[:, -1]
    return np.asarray((least * longest >= 1.0).reshape(rectifier.valid.shape))


def _radius_sq(camera: CameraModel, rectifier: Rectifier) -> Floats:
    points = rectifier.grid.points()
    uv, _ = camera.project(points)
    half = 0.25 * (camera.width**2 + camera.height**2)
    radius_sq = np.sum((np.nan_to_num(uv) - camera.K[:2, 2]) ** 2, axis=1) / half
    return np.where(rectifier.valid, radius_sq.reshape(rectifier.valid.shape), 0.0)
