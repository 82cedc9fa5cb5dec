# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera image with the matched map drawn into it, for a visual check by a person."""

from __future__ import annotations

from dataclasses import replace
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from gip_localizer.core.arrays import Grey
from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Match
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import map_window
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import Pose2

Picture = NDArray[np.uint8]
Points = NDArray[np.float64]

SAMPLES, FINE = 2, 2
"""Map samples per side of a cell, and pixels per sample, for finding outlines; chosen."""
SHORTEST = 0.3
"""Shortest outline that is drawn, metres; shorter ones are mostly texture; chosen."""
PUBLISHED, WITHHELD = (80, 230, 60), (40, 150, 255)
"""Colours of outlines of published and of withheld poses: blue, green, red, 0 to 255; chosen."""
WHITE = (255, 255, 255)
"""Blue, green, red, 0 to 255."""
INSET = 0.28
"""Height of the score surface, as a fraction of the picture's height; chosen."""
FONT = cv2.FONT_HERSHEY_SIMPLEX


def camera_overlay(
    image: Grey, camera: CameraModel | None, raster_map: RasterMap, estimate: Estimate
) -> Picture:
    """
    Draw the result of the localizer into the camera image.

    Parameters
    ----------
    image : (height, width) uint8, uint16 or float32
        The camera image.
    camera : CameraModel or None
        Camera that took the image; None: no outlines are drawn.
    raster_map : RasterMap
        Map whose outlines are drawn: green if the pose is published, orange if it is withheld.
    estimate : Estimate
        Estimate of the frame, with its `match`.

    Returns
    -------
    (height, width, 3) uint8
        Blue, green, red: image, outlines, likelihood of the search window in a corner, status.

    """
    picture = cv2.cvtColor(_eight_bits(image), cv2.COLOR_GRAY2BGR)
    colour = PUBLISHED if estimate.published else WITHHELD
    match = estimate.match
    pose = _pose(estimate)
    if camera is not None and match is not None and pose is not None:
        lines = map_outlines(raster_map, match.view.grid, pose)
        _draw_lines(picture, _as_matched(camera, match), lines, colour)
    if match is not None and match.scores is not None:
        _draw_inset(picture, match.scores)
    _write(picture, _text(estimate), colour)
    return np.asarray(picture, np.uint8)


def outlines_at(
    image: Grey, camera: CameraModel, raster_map: RasterMap, grid: Grid, pose: Pose2
) -> Picture:
    """Return the image (height, width, 3) with the map's outlines as seen from a known pose."""
    picture = cv2.cvtColor(_eight_bits(image), cv2.COLOR_GRAY2BGR)
    _draw_lines(picture, camera, map_outlines(raster_map, grid, pose), PUBLISHED)
    return np.asarray(picture, np.uint8)


def map_outlines(raster_map: RasterMap, grid: Grid, pose: Pose2) -> list[Points]:
    """
    Return the outlines of the bright areas in a window of the map.

    Parameters
    ----------
    raster_map : RasterMap
        The map.
    grid : Grid
        The window, in the base frame.
    pose : Pose2
        T_map_base.

    Returns
    -------
    list of (n, 2) float64
        Lines in the base frame, metres. They end at the edge of the window and of the known map.

    """
    grid = Grid(grid.far, grid.left, grid.rows * SAMPLES, grid.cols * SAMPLES,
                grid.resolution / SAMPLES)
    window, share = map_window(raster_map, grid, pose)
    known = share > 0.0
    if not known.any():
        return []
    bright = _bright(window, known)
    inside = cv2.erode(
        cv2.resize(known.astype(np.uint8), None, fx=FINE, fy=FINE), np.ones((3, 3), np.uint8),
        borderType=cv2.BORDER_CONSTANT, borderValue=0,
    )
    contours = cv2.findContours(bright, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)[0]
    least = SHORTEST * FINE / grid.resolution
    lines: list[Points] = []
    for contour in contours:
        for run in _runs(contour[:, 0, :], inside):
            if len(run) >= least:
                metres = (run + 0.5) * (grid.resolution / FINE)
                lines.append(np.column_stack([grid.far - metres[:, 1], grid.left - metres[:, 0]]))
    return lines


def _bright(window: NDArray[np.float32], known: NDArray[np.bool_]) -> Picture:
    """Return the cells above Otsu's threshold as a picture, `FINE` times as large."""
    low, high = np.percentile(window[known], (1.0, 99.0))
    scaled = np.where(known, (window - low) / max(float(high - low), 1e-6), 0.0)
    fine = cv2.resize(np.clip(scaled, 0.0, 1.0), None, fx=FINE, fy=FINE)
    grey = cv2.GaussianBlur(np.round(255.0 * fine).astype(np.uint8), (0, 0), 0.7 * FINE)
    return np.asarray(cv2.threshold(grey, 0, 255, cv2.THRESH_BINARY + cv2.THRESH_OTSU)[1])


def _runs(points: NDArray[np.int32], inside: Picture) -> list[NDArray[np.int32]]:
    """Cut a closed contour (columns, rows) where it leaves the inside."""
    kept = inside[points[:, 1], points[:, 0]] > 0
    if kept.all():
        return [np.vstack([points, points[:1]])]
    first = int(np.argmin(kept))  # start outside, so that no run is split
    points, kept = np.roll(points, -first, axis=0), np.roll(kept, -first)
    parts = np.split(np.arange(len(points)), np.flatnonzero(np.diff(kept)) + 1)
    return [points[part] for part in parts if kept[part[0]]]


def _pose(estimate: Estimate) -> Pose2 | None:
    if estimate.match is not None and estimate.match.fit is not None:
        return estimate.match.fit.pose
    return estimate.pose


def _as_matched(camera: CameraModel, match: Match) -> CameraModel:
    """Return the camera with the pitch, roll and height that the match found."""
    if match.fit is None:
        return camera
    pitch, roll, height = (float(value) for value in match.fit.camera_motion)
    held = camera.extrinsics
    return camera.with_extrinsics(replace(
        held, pitch=held.pitch + pitch, roll=held.roll + roll, z=held.z + height
    ))


def _draw_lines(
    picture: Picture, camera: CameraModel, lines: list[Points], colour: tuple[int, int, int]
) -> None:
    width = max(1, round(picture.shape[1] / 700))
    limit = 4.0 * max(picture.shape)
    for line in lines:
        uv, valid = camera.project(line)
        near = valid & (np.abs(np.nan_to_num(uv, nan=1e9)).max(axis=1) < limit)
        parts = np.split(np.arange(len(uv)), np.flatnonzero(np.diff(near)) + 1)
        sixteenths = [np.round(16.0 * uv[part]).astype(np.int32)[:, None, :]
                      for part in parts if near[part[0]] and len(part) > 1]
        cv2.polylines(picture, sixteenths, False, colour, width, cv2.LINE_AA, shift=4)


def _draw_inset(picture: Picture, scores: Scores) -> None:
    """Draw the likelihood at the best heading in the upper right: up is ahead, left is left."""
    yaw, row, col = scores.best()
    plane = scores.residual[yaw]
    finite = np.isfinite(plane)
    if not finite.any():
        return
    worst, least = float(np.percentile(plane[finite], 95.0)), float(plane[finite].min())
    share = np.where(finite, (worst - plane) / max(worst - least, 1e-12), 0.0)
    heat = cv2.applyColorMap(
        np.round(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8), cv2.COLORMAP_VIRIDIS
    )
    side = max(round(INSET * picture.shape[0] / max(heat.shape[:2])), 1)
    heat = cv2.resize(heat, None, fx=side, fy=side, interpolation=cv2.INTER_NEAREST)
    middle = (side * col + side // 2, side * row + side // 2)
    cv2.drawMarker(heat, middle, (60, 60, 255), cv2.MARKER_CROSS, max(5 * side, 9), 2)
    heat = cv2.copyMakeBorder(heat, 2, 2, 2, 2, cv2.BORDER_CONSTANT, value=WHITE)
    rows, cols = min(heat.shape[0], picture.shape[0]), min(heat.shape[1], picture.shape[1])
    picture[:rows, picture.shape[1] - cols:] = heat[:rows, :cols]


def _text(estimate: Estimate) -> list[str]:
    lines = [f'{estimate.status}  {estimate.stamp_ns // 10**9}.{estimate.stamp_ns % 10**9:09d}']
    if estimate.pose is not None and estimate.covariance is not None:
        x, y, yaw = estimate.pose
        sigma = math.sqrt(max(estimate.covariance[0, 0], estimate.covariance[1, 1]))
        lines.append(f'x {x:.3f}  y {y:.3f} m  yaw {math.degrees(yaw):.2f} deg  '
                     f'sigma {1e3 * sigma:.1f} mm')
    else:
        lines.append(estimate.reason)
    figures = [(name, estimate.quality[name]) for name in ('confidence', 'correlation', 'overlap')
               if name in estimate.quality]
    lines.append('  '.join(f'{name} {value:.2f}' for name, value in figures))
    return [line.encode('ascii', 'replace').decode() for line in lines if line]


def _write(picture: Picture, lines: list[str], colour: tuple[int, int, int]) -> None:
    """Write the lines on a darkened band at the bottom, which often shows the vehicle itself."""
    size = max(picture.shape[1] / 1600.0, 0.4)
    height = round(34 * size)
    band = picture[max(picture.shape[0] - height * len(lines) - height // 2, 0):]
    band[:] = band // 3
    for n, line in enumerate(lines):
        at = (round(10 * size), height * (n + 1))
        fitting = _cut(line, size, picture.shape[1] - 2 * at[0])
        cv2.putText(band, fitting, at, FONT, size, colour if n == 0 else WHITE, 1, cv2.LINE_AA)


def _cut(line: str, size: float, width: int) -> str:
    """Return the line, shortened to the width in px if necessary."""
    full = line
    while line and cv2.getTextSize(line + '...', FONT, size, 1)[0][0] > width:
        line = line[:-1]
    return full if cv2.getTextSize(full, FONT, size, 1)[0][0] <= width else line + '...'


def _eight_bits(image: Grey) -> Picture:
    """Return an image of 8 bits unchanged, and one of more bits stretched to 8 bits."""
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = np.percentile(image, (1.0, 99.0))
    share = (image.astype(np.float32) - low) / max(float(high - low), 1e-9)
    return np.round(255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)
