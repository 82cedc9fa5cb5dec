# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A view that suits a camera, with the standard deviation that it allows, and its picture."""

from __future__ import annotations

from dataclasses import dataclass
from io import BytesIO
import math

import cv2
from matplotlib import rc_context
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.birdseye.footprints import footprint_areas
from gip_localizer.core.birdseye.rectifier import make_grid
from gip_localizer.core.birdseye.view_choice import choose_view
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.gramian import gramian
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.parameters import Birdseye, Score
from gip_localizer.visualization.style import STYLE, WRONG

PIXEL_NOISE = 0.01
"""Assumed standard deviation of a pixel's noise where `score.pixel_noise` is 0, grey levels of
[0, 1]; chosen: that of a usual camera by day."""
MARGIN = 0.25
"""Road around the view that the picture shows, per length of the view; chosen."""


@dataclass(frozen=True, eq=False)
class Suggestion:
    """
    The view that suits a camera.

    Attributes
    ----------
    camera : CameraModel
        The camera.
    view : Birdseye
        The view.
    cells : int
        Number of its cells inside the image.
    sigma : (3,) float64 or None
        Least standard deviation of x, y (m) and yaw (rad) of a frame by the Cramér-Rao bound, if
        road, map and calibration are exact; None without a map.

    """

    camera: CameraModel
    view: Birdseye
    cells: int
    sigma: Floats | None


def suggest_view(camera: CameraModel, raster_map: RasterMap | None, score: Score) -> Suggestion:
    """
    Choose the view of a camera.

    Parameters
    ----------
    camera : CameraModel
        Calibrated camera and its pose in the base frame.
    raster_map : RasterMap or None
        The map, if there is one.
    score : Score
        Noise of pixels and of the map.

    Raises
    ------
    CalibrationError
        The camera sees no road.

    """
    view = choose_view(camera, None if raster_map is None else raster_map.resolution)
    area, valid = footprint_areas(camera, make_grid(view))
    sigma = None if raster_map is None else _sigma(view, area, raster_map, score)
    return Suggestion(camera, view, int(valid.sum()), sigma)


def _sigma(view: Birdseye, area: Floats, raster_map: RasterMap, score: Score) -> Floats:
    """Return the Cramér-Rao bound (3,) for the mean squared slope of the map, m and rad."""
    weight = gramian(
        area.astype(np.float32), pixel_noise=score.pixel_noise or PIXEL_NOISE,
        map_noise=score.map_noise,
    ).ravel().astype(float)
    information = 0.5 * _squared_slope(raster_map, view.resolution) * weight
    points = make_grid(view).points()
    ones = np.ones(len(points))
    along = np.stack([ones, np.zeros_like(ones), -points[:, 1]], axis=1)
    across = np.stack([np.zeros_like(ones), ones, points[:, 0]], axis=1)
    matrix = sum(rows.T @ (information[:, None] * rows) for rows in (along, across))
    return np.asarray(np.sqrt(np.diag(np.linalg.pinv(matrix))))


def _squared_slope(raster_map: RasterMap, side: float) -> float:
    """Return the mean squared slope of the map on cells of a side (m), 1/m²."""
    known = np.ones(raster_map.grey.shape, bool) if raster_map.valid is None else raster_map.valid
    grey = on_unit_scale(raster_map.grey).astype(np.float32)
    count = max(round(side / raster_map.resolution), 1)
    down, right = np.gradient(cv2.blur(grey, (count, count)), raster_map.resolution)
    whole = cv2.erode(known.astype(np.uint8), np.ones((count + 2, count + 2), np.uint8)) > 0
    return float(np.mean((down**2 + right**2)[whole])) if whole.any() else 0.0


def suggestion_picture(found: Suggestion, kind: str) -> bytes:
    """Draw the outline of the view over the footprints of its cells; `kind`: png or svg."""
    view = found.view
    reach = MARGIN * (view.far - view.near)
    wide = Birdseye(view.near - reach, view.far + reach, view.half_width + reach, view.resolution)
    area, valid = footprint_areas(found.camera, make_grid(wide))
    pixels = np.where(valid, np.log10(np.maximum(area, 1e-3)), math.nan)
    sides = (wide.half_width, -wide.half_width, wide.near, wide.far)
    with rc_context({**STYLE, 'axes.grid': False}):
        figure = Figure(figsize=(6.4, 6.0))
        axes = figure.subplots()
        shown = axes.imshow(pixels, extent=sides, cmap='viridis')
        figure.colorbar(shown, label='log10 of the footprint of a cell [square pixels]')
        axes.add_patch(Rectangle((-view.half_width, view.near), 2.0 * view.half_width,
                                 view.far - view.near, fill=False, color=WRONG, lw=2.0))
        axes.set(xlabel='left [m]', ylabel='ahead of base_link [m]',
                 title=f'view of cells of {100.0 * view.resolution:.3g} cm')
        picture = BytesIO()
        figure.savefig(picture, format=kind, dpi=110)
    return picture.getvalue()
