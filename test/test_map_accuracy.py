# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The stated accuracy of a map: in its file, in the parameters, and in every covariance."""

from __future__ import annotations

from dataclasses import replace

from match_samples import texture
import numpy as np
import pytest
from test_localizer import CAMERA, make, S

from gip_localizer.core.map.accuracy import MapAccuracy
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError
from gip_localizer.io.map_files import load_map, save_map

STATED = MapAccuracy(sigma_xy=0.02, sigma_yaw=0.001)
ALONE = {'motion.fuse': False}
BY_PARAMETERS = {'map.sigma_xy': STATED.sigma_xy, 'map.sigma_yaw': STATED.sigma_yaw}


def test_it_comes_back_from_disk_and_an_exact_map_names_none(tmp_path):
    raster = RasterMap(texture(40, 30), 0.05, Pose2(1.0, 2.0, 0.1))
    save_map(raster, tmp_path / 'exact.yaml')
    assert 'sigma' not in (tmp_path / 'exact.yaml').read_text()
    assert load_map(tmp_path / 'exact.yaml').accuracy == MapAccuracy()
    save_map(replace(raster, accuracy=STATED), tmp_path / 'stated.yaml')
    assert load_map(tmp_path / 'stated.yaml').accuracy == STATED


@pytest.mark.parametrize('line', [
    'sigma_xy: -0.01', 'sigma_xy: 11', 'sigma_xy: .nan', 'sigma_yaw: 5', 'sigma_yaw: wide',
    'sigma_xy: [0.1]',
])  # fmt: skip
def test_a_value_that_is_no_standard_deviation_is_refused_by_name(tmp_path, line):
    path = tmp_path / 'map.yaml'
    save_map(RasterMap(texture(40, 30), 0.05), path)
    path.write_text(path.read_text() + line + '\n')
    with pytest.raises(MapError, match=line.split(':')[0]):
        load_map(path)


def localized(road, raster_map: RasterMap, **settings: float):
    truth = road.pose(0.3)
    localizer = make(road, **settings)
    localizer.change_map(raster_map)
    localizer.set_prior(0, truth, np.diag([0.05, 0.05, 0.01]) ** 2)
    return localizer, localizer.update(S, road.frame(CAMERA, truth), CAMERA)


@pytest.mark.parametrize('way', ['map', 'parameters', 'both'])
def test_it_is_part_of_every_covariance_and_the_larger_one_counts(road, way):
    _, exact = localized(road, road.map, **ALONE)
    worse = MapAccuracy(0.5 * STATED.sigma_xy, 0.5 * STATED.sigma_yaw)
    accuracy = {'map': STATED, 'parameters': MapAccuracy(), 'both': worse}[way]
    settings = ALONE if way == 'map' else {**ALONE, **BY_PARAMETERS}
    _, stated = localized(road, replace(road.map, accuracy=accuracy), **settings)
    assert stated.pose == exact.pose
    added = stated.covariance - exact.covariance
    assert added == pytest.approx(STATED.covariance(), rel=0.02, abs=1e-9)


def test_it_does_not_average_out_over_the_frames(road):
    truth, raster_map = road.pose(0.3), replace(road.map, accuracy=STATED)
    localizer, estimate = localized(road, raster_map)
    for number in range(2, 8):
        estimate = localizer.update(number * S, road.frame(CAMERA, truth, seed=number), CAMERA)
    assert estimate.published
    assert np.sqrt(estimate.covariance[0, 0]) > 0.99 * STATED.sigma_xy
