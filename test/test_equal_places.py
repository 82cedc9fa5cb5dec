# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A straight road of dashes: the next dash is silence, and the arrow ends it."""

from __future__ import annotations

import math

from camera_samples import make_camera
import numpy as np
import pytest

from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.parameters import Parameters
from gip_localizer.synthetic import markings
from gip_localizer.synthetic.canvas import Canvas, paint
from gip_localizer.synthetic.paths import Path
from gip_localizer.synthetic.renderer import Renderer
from gip_localizer.synthetic.sensor import SensorModel
from gip_localizer.synthetic.worlds import map_of

S = 1_000_000_000
CAMERA = make_camera()
LENGTH, WIDTH, CELL = 84.0, 9.0, 0.025  # m
LANE_Y = 0.5 * WIDTH - 1.75  # m
ASPHALT, PAINT = 0.3, 0.78  # reflectance
ONLY_DASHES, ARROW = 29.2, 48.0  # m along the road: what is in view from there
SIGMA = 3.5  # m, of the prior along and across the road
SPEED = 8.0  # m/s


class DashRoad:
    """The road, its map and what the camera sees; an arrow and a stop line every 40 m."""

    def __init__(self) -> None:
        canvas = Canvas.of_size(LENGTH, WIDTH, CELL)
        ends = np.array([[0.0, 0.5 * WIDTH], [0.5 * LENGTH, 0.5 * WIDTH], [LENGTH, 0.5 * WIDTH]])
        road = Path(ends, closed=False)
        outlines = [
            *markings.dashed_line(road, 0.0), *markings.solid_line(road, 3.5),
            *markings.solid_line(road, -3.5),
        ]
        for station in (20.0, 60.0):
            outlines += markings.stop_line(road, station, -3.4, -0.1)
            outlines.append(
                markings.symbol(road, markings.STRAIGHT_ARROW, station - 6.0, -1.75)
            )
        grey = np.full(canvas.shape, ASPHALT, np.float32)
        paint(grey, canvas.polygons(outlines), PAINT)
        world = RasterMap(grey, CELL, Pose2(0.0, 0.0, 0.0))
        self.map = map_of(world, 2)
        self._renderer = Renderer(world, CAMERA)

    def frame(self, station: float, seed: int = 0) -> np.ndarray:
        """The image from a place in the middle of the right lane, with noise."""
        return SensorModel(read_noise=0.01).capture(self._renderer.render(at(station)), seed, 0)


def at(station: float) -> Pose2:
    return Pose2(station, LANE_Y, 0.0)


@pytest.fixture(scope='module')
def road() -> DashRoad:
    return DashRoad()


def started(road: DashRoad, station: float, offset: float) -> Localizer:
    """A localizer whose prior is so many metres along the road from the truth."""
    localizer = Localizer(road.map, Parameters.from_dict({
        'birdseye.near': 3.0, 'birdseye.far': 10.0, 'birdseye.half_width': 3.0,
        'birdseye.resolution': 0.05,
        'recovery.automatic': False,
    }))
    prior = at(station) @ Pose2(offset, 0.1, 0.01)
    localizer.set_prior(0, prior, np.diag([SIGMA**2, 0.3**2, 0.03**2]))
    return localizer


def right(estimate: Estimate, station: float) -> bool:
    """Whether a frame is silent, or where the vehicle is."""
    if estimate.pose is None:
        return True
    apart = difference(estimate.pose, at(station))
    return math.hypot(apart[0], apart[1]) < 0.05


@pytest.mark.parametrize('offset', [5.9, 0.0])
def test_a_place_whose_equal_lies_within_the_prior_is_not_published(road, offset):
    """With 5.9 m the window holds the wrong dash alone; with 0 the right one alone."""
    localizer = started(road, ONLY_DASHES, offset)
    estimate = localizer.update(S, road.frame(ONLY_DASHES), CAMERA)
    assert estimate.status is Status.AMBIGUOUS, estimate.reason
    assert localizer.state.from_initialpose  # the prior is kept


def test_a_prior_that_excludes_the_next_dash_decides(road):
    localizer = Localizer(road.map, started(road, ONLY_DASHES, 0.0).parameters)
    sharp = np.diag([1.0**2, 0.3**2, 0.03**2])
    localizer.set_prior(0, at(ONLY_DASHES) @ Pose2(0.6, 0.1, 0.01), sharp)
    estimate = localizer.update(S, road.frame(ONLY_DASHES), CAMERA)
    assert estimate.published, estimate.reason
    assert right(estimate, ONLY_DASHES)


@pytest.mark.parametrize('offset', [5.9, 0.0])
def test_an_arrow_in_view_settles_it_at_once_though_outside_the_window(road, offset):
    estimate = started(road, ARROW, offset).update(S, road.frame(ARROW), CAMERA)
    assert estimate.published, estimate.reason
    assert right(estimate, ARROW)


@pytest.mark.parametrize('odometry', [True, False])
def test_no_dash_is_chosen_on_the_way_to_the_arrow(road, odometry):
    start, estimates = 42.8, []
    localizer = started(road, start, 5.9)
    for i in range(10):
        for part in range(4, -1, -1) if odometry else ():
            seconds = 0.1 * i - 0.02 * part
            moved = Pose2(SPEED * seconds, 0.0, 0.0)
            localizer.add_odometry(OdometrySample(S + round(S * seconds), moved, SPEED))
        station = start + 0.1 * SPEED * i
        image = road.frame(station, seed=i)
        estimates.append(localizer.update(S + i * S // 10, image, CAMERA))
        assert right(estimates[-1], station), i
    assert not estimates[0].published
