# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The search of the whole map: its cells, its modes, and where it finds a view."""

from __future__ import annotations

from dataclasses import replace
import math
from types import SimpleNamespace

from match_samples import texture
import numpy as np
import pytest

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.match.lattice import Lattice
from gip_localizer.core.match.pyramid import whole_window
from gip_localizer.core.match.pyramid.coarse_to_fine import pyramid_modes
from gip_localizer.core.match.score_surface import Scores
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.core.search import whole_map
from gip_localizer.core.search.global_search import coarse_places, KEPT, with_surroundings, WITHIN
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.search_result import SearchResult
from gip_localizer.core.search.whole_map import average_map
from gip_localizer.parameters import Parameters

GRID = Grid(8.0, 3.0, 60, 60, 0.1)
WEIGHT = np.repeat(np.linspace(0.3, 1.0, GRID.rows)[:, None], GRID.cols, 1).astype('f4')
ORIGIN = Pose2(-7.0, 3.0, 0.6)
GREY = 0.6 * texture((300, 420), 4, 2.0) + 0.4 * texture((300, 420), 5, 6.0)
MAP = RasterMap(GREY, 0.1, ORIGIN)
PARAMETERS = Parameters()


def view_at(pose: Pose2, raster_map: RasterMap = MAP, *, car: bool = False) -> View:
    rng = np.random.default_rng(1)
    values = raster_map.sample(pose.transform(GRID.points()))[0].reshape(GRID.shape)
    values = (0.3 * values + 0.05 * np.linspace(0.0, 1.0, GRID.cols)).astype('f4')  # dim, uneven
    values += 0.01 * rng.standard_normal(GRID.shape, np.float32)
    if car:
        values[10:40, :18] = 0.9
    return View(values, WEIGHT, WEIGHT > 0.0, GRID)


@pytest.mark.parametrize('heading', [0.0, 1.0, -2.5, math.pi])
@pytest.mark.parametrize('car', [False, True])
def test_a_view_is_found_anywhere_on_a_turned_map(heading, car):
    truth = MAP.origin @ Pose2(22.0, 14.0, heading)
    places = coarse_places(view_at(truth, car=car), WEIGHT, MapCrops(MAP), PARAMETERS)
    x, y, yaw = difference(places[0].pose, truth)
    assert math.hypot(x, y) < 0.2
    assert abs(yaw) < 0.04


def test_places_that_are_equal_are_all_returned():
    twice = replace(MAP, grey=np.hstack([GREY[:, :200], GREY[:, :200]]))
    truth = ORIGIN @ Pose2(6.0, 14.0, 0.3)
    twin = ORIGIN @ Pose2(26.0, 14.0, 0.3)
    places = coarse_places(view_at(truth, twice), WEIGHT, MapCrops(twice), PARAMETERS)
    for expected in (truth, twin):
        offsets = [difference(place.pose, expected) for place in places[:2]]
        assert min(math.hypot(x, y) for x, y, _ in offsets) < 0.2


def test_a_map_that_is_averaged_in_strips_is_the_same(monkeypatch):
    valid = np.ones(GREY.shape, bool)
    valid[40:90, 100:200] = False
    raster_map = replace(MAP, valid=valid)
    whole = average_map(raster_map, 0.2, patterned=False)
    monkeypatch.setattr(whole_map, 'STRIP_CELLS', 20_000)
    strips = average_map(raster_map, 0.2, patterned=False)
    np.testing.assert_array_equal(strips.known, whole.known)
    np.testing.assert_allclose(strips.values, whole.values, atol=1e-5)
    assert not whole.known.all()
    assert whole.known.any()


def test_yaws_in_blocks_give_the_same_modes(monkeypatch):
    level = average_map(MAP, 0.2, patterned=True).level(
        view_at(MAP.origin @ Pose2(22.0, 14.0, 1.0)), WEIGHT, 0.05
    )
    rule = {'normalized': True, 'min_overlap': 0.5, 'count': 3, 'kept': KEPT, 'within': WITHIN}
    expected = pyramid_modes(level, **rule)
    monkeypatch.setattr(whole_window, 'BLOCK_CANDIDATES', 1)
    found = pyramid_modes(level, **rule)
    assert found[0] == expected[0]


@pytest.mark.parametrize('normalized', [True, False])
@pytest.mark.parametrize('grey', [0.0, 0.4])
def test_a_map_of_one_grey_ends_with_few_places_or_none(grey, normalized):
    flat = replace(MAP, grey=np.full(GREY.shape, grey, np.float32))
    metric = 'gip_normalized' if normalized else 'gip'
    parameters = PARAMETERS.replace({'score.metric': metric})
    view = view_at(MAP.origin @ Pose2(22.0, 14.0, 1.0))
    assert len(coarse_places(view, WEIGHT, MapCrops(flat), parameters)) <= 12


def test_a_map_without_data_has_no_place_for_a_plain_metric():
    empty = replace(MAP, valid=np.zeros(GREY.shape, bool))
    parameters = PARAMETERS.replace({'score.metric': 'gip'})
    assert coarse_places(view_at(ORIGIN), WEIGHT, MapCrops(empty), parameters) == []


def result_at(pose: Pose2, fit_score: float, anchor: Pose2) -> SearchResult:
    """A search of 0.4 m around an anchor; of its fit no more than is compared."""
    lattice = Lattice(anchor, 0.1, (4, 4), np.zeros(1))
    nothing = np.zeros(lattice.shape, np.float32)
    fit = SimpleNamespace(pose=pose, fit_score=fit_score)
    return SearchResult(Scores(lattice, nothing, nothing, nothing), None, [fit])


@pytest.mark.parametrize(('again', 'wins'), [(None, 'first'), (0.1, 'first'), (0.9, 'aside')])
def test_the_best_place_wins_whatever_a_look_around_the_first_finds(again, wins):
    places = {'first': Pose2(1.0, 0.0, 0.0), 'other': Pose2(9.0, 0.0, 0.0),
              'aside': Pose2(3.0, 0.0, 0.0)}
    first = result_at(places['first'], 0.6, Pose2(0.0, 0.0, 0.0))  # beyond its window
    other = result_at(places['other'], 0.5, places['other'])
    looks = []

    def look(pose):
        looks.append(pose)
        return None if again is None else result_at(places['aside'], again, pose)

    best, second = with_surroundings([first, other], look)
    assert looks == [places['first']]
    assert best.fits[0].pose == places[wins]
    assert second is other


def test_the_averaged_map_is_made_once():
    crops = MapCrops(MAP)
    assert crops.whole(0.2, patterned=True) is crops.whole(0.2, patterned=True)
    assert crops.whole(0.2, patterned=False).patterned is False
