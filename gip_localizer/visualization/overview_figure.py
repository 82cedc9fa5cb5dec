# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The picture of the README: the steps of the localizer for one frame of the demo bag.

`make figures` draws it from the bag and the map in `bags/demo`.

"""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
import sys

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Match
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import BagError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.topics import choose_topics, TopicNames
from gip_localizer.io.images import compressed_grey_image
from gip_localizer.io.map_files import load_map
from gip_localizer.io.messages import calibration
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.session.frontend import Frontend
from gip_localizer.visualization.style import ESTIMATE, STYLE, WRONG

FRAME = 12
"""Number of the shown frame among the localized ones; chosen, because it shows an arrow."""
AROUND = (-8.0, 18.0, -6.0, 7.0)
"""Shown part of the map: behind, ahead, right and left of the vehicle, metres; chosen."""
WINDOW = {'search.x': 1.5, 'search.y': 1.5}
"""Half-widths of the search window, metres; chosen to show the scores around the maximum."""


def overview_figure(folder: Path) -> Figure:
    """
    Draw camera image, bird's-eye view, footprints, map and scores of one frame.

    Parameters
    ----------
    folder : Path
        A bag as `gip simulate` writes it, of compressed images, with its map and parameters.

    Returns
    -------
    Figure
        Five panels.

    Raises
    ------
    GipError
        The bag cannot be used, or too few of its frames are localized.

    """
    raster_map = load_map(folder / 'map.yaml')
    parameters = load_parameter_file(folder / 'params.yaml').replace(WINDOW)
    image, camera, estimate = _localized_frame(Bag([folder]), raster_map, parameters)
    assert estimate.pose is not None
    assert estimate.match is not None
    with rc_context({**STYLE, 'axes.grid': False}):
        figure = Figure(figsize=(10.4, 5.8))
        halves = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.0, 0.95))[:, 0]
        first = halves[0].subplots(1, 3, width_ratios=(1.78, 0.86, 0.98))
        _draw_camera(first[0], image, camera, estimate.match)
        _draw_view(first[1], estimate.match)
        _draw_footprints(first[2], estimate.match)
        second = halves[1].subplots(1, 2, width_ratios=(1.0, 1.75))
        _draw_scores(second[0], estimate.match)
        _draw_map(second[1], raster_map, estimate)
    return figure


def _localized_frame(
    bag: Bag, raster_map: RasterMap, parameters: Parameters
) -> tuple[Grey, CameraModel, Estimate]:
    topics = choose_topics(bag, TopicNames())
    frontend = Frontend(raster_map, parameters)
    frames = 0
    for message in bag.messages(topics.replayed):
        decoded = bag.decode(message)
        if message.topic == topics.camera_info.name:
            frontend.on_camera_info(decoded)
            numbers = calibration(decoded)
        elif message.topic == topics.image.name:
            estimate = frontend.on_compressed_image(decoded)
            frames += estimate.published
            if frames == FRAME:
                camera = CameraModel.given(numbers, parameters.camera)
                return compressed_grey_image(decoded), camera, estimate
        elif topics.odometry is not None and message.topic == topics.odometry.name:
            frontend.on_odometry(decoded)
    raise BagError(f'only {frames} frames of the bag are localized, {FRAME} are needed')


def _outline(match: Match) -> Floats:
    """Return the edge of the view, (n, 2) metres in the base frame, closed."""
    grid = match.view.grid
    corners = np.array([
        (grid.far, grid.left), (grid.far, -grid.left),
        (grid.far - grid.rows * grid.resolution, -grid.left),
        (grid.far - grid.rows * grid.resolution, grid.left), (grid.far, grid.left),
    ])
    steps = np.linspace(0.0, 1.0, 60)[:, None]
    return np.vstack([a + steps * (b - a) for a, b in pairwise(corners)])


def _extent(match: Match) -> tuple[float, float, float, float]:
    grid = match.view.grid
    return grid.left, -grid.left, grid.far - grid.rows * grid.resolution, grid.far


def _draw_camera(axes: Axes, image: Grey, camera: CameraModel, match: Match) -> None:
    axes.imshow(image, cmap='gray')
    outline = _outline(match)
    pixels, valid = camera.project(outline)
    pixels[~valid] = np.nan
    axes.plot(pixels[:, 0], pixels[:, 1], color=ESTIMATE, lw=2.0)
    height, width = image.shape
    axes.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), xticks=[], yticks=[])
    axes.set_title('camera image, with the road that is matched')


def _draw_view(axes: Axes, match: Match) -> None:
    view = match.view
    axes.imshow(np.where(view.valid, view.patch, np.nan), cmap='gray', extent=_extent(match))
    axes.set(xlabel='left [m]', ylabel='ahead [m]')
    axes.set_title("1  bird's-eye view v")


def _draw_footprints(axes: Axes, match: Match) -> None:
    view = match.view
    shown = axes.imshow(
        np.where(view.valid, view.footprint, np.nan), extent=_extent(match), cmap='viridis',
        norm=LogNorm(),
    )  # fmt: skip
    axes.figure.colorbar(shown, ax=axes, label='px² per cell')
    axes.set(xlabel='left [m]', yticks=[])
    axes.set_title('2  weight G ∝ footprint Ã')


def _draw_map(axes: Axes, raster_map: RasterMap, estimate: Estimate) -> None:
    assert estimate.pose is not None
    assert estimate.match is not None
    pose = estimate.pose
    low_x, high_x = pose.x + AROUND[0], pose.x + AROUND[1]
    low_y, high_y = pose.y + AROUND[2], pose.y + AROUND[3]
    x, y = np.meshgrid(np.arange(low_x, high_x, 0.05), np.arange(high_y, low_y, -0.05))
    values, known = raster_map.sample(np.column_stack([x.ravel(), y.ravel()]))
    window = np.where(known, values, np.nan).reshape(x.shape)
    axes.imshow(window, cmap='gray', extent=(low_x, high_x, low_y, high_y))
    axes.plot(*pose.transform(_outline(estimate.match)).T, color=ESTIMATE, lw=2.0)
    _draw_vehicle(axes, pose)
    axes.set(xlabel='map x [m]', ylabel='map y [m]')
    assert estimate.covariance is not None
    sigma_mm = 1e3 * np.sqrt(np.diag(estimate.covariance)[:2].sum())
    axes.set_title(f'4  pose on the map: ({pose.x:.3f}, {pose.y:.3f}) m, σ {sigma_mm:.1f} mm')


def _draw_vehicle(axes: Axes, pose: Pose2) -> None:
    body = np.array([(1.2, 0.0), (-0.8, 0.7), (-0.4, 0.0), (-0.8, -0.7), (1.2, 0.0)])
    axes.fill(*pose.transform(body).T, color=WRONG, zorder=3)


def _draw_scores(axes: Axes, match: Match) -> None:
    assert match.scores is not None
    best = match.scores.best()[0]
    surface = match.scores.correlation[best]
    lattice = match.scores.lattice
    reach_x, reach_y = (0.5 * size * lattice.step for size in surface.shape)
    shown = axes.imshow(
        surface, extent=(reach_y, -reach_y, -reach_x, reach_x), cmap='magma'
    )
    axes.figure.colorbar(shown, ax=axes, label='correlation under G')
    axes.set(xlabel='left of the prior [m]', ylabel='ahead [m]')
    axes.set_title('3  score of every candidate û, best heading')


def main() -> int:
    """Write the figure; the arguments are the bag's folder and the PNG file."""
    folder, target = (Path(argument) for argument in sys.argv[1:3])
    overview_figure(folder).savefig(target, dpi=94, metadata={'Software': None})
    return 0


if __name__ == '__main__':
    sys.exit(main())
