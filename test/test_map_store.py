# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Large maps: mapped from disk, the same cells, bounded, and safe where nothing can be written."""

from __future__ import annotations

import os
import tracemalloc

import cv2
from match_samples import texture
import numpy as np
import pytest

from gip_localizer.core.birdseye.grid import Grid
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.search.window import SearchWindow
from gip_localizer.io import map_cache as map_store
from gip_localizer.io.map_files import load_map, save_map

GREY = (texture((120, 150)) * 255).astype(np.uint8)


@pytest.fixture
def store(tmp_path, monkeypatch):
    """An empty store for maps of more than 1000 cells."""
    monkeypatch.setenv('XDG_CACHE_HOME', str(tmp_path / 'cache'))
    monkeypatch.setattr(map_store, 'LARGE', 1000)
    return map_store.store_folder()


def written(folder, grey=GREY, valid=None, name='map'):
    path = folder / f'{name}.yaml'
    save_map(RasterMap(grey, 0.1, Pose2(1.0, 2.0, 0.3), valid), path)
    return path


def no_decoding(*_):
    raise AssertionError('decoded again')


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('masked', [False, True])
def test_a_large_map_is_mapped_and_has_the_same_cells(tmp_path, store, monkeypatch, dtype, masked):
    grey = (texture((120, 150)) * np.iinfo(dtype).max).astype(dtype)
    valid = np.ones(grey.shape, bool)
    valid[3:9, 10:40] = False
    path = written(tmp_path, grey, valid if masked else None)
    first = load_map(path)
    monkeypatch.setattr(cv2, 'imread', no_decoding)
    again = load_map(path)
    for raster_map in (first, again):
        np.testing.assert_array_equal(raster_map.grey, grey)
        assert raster_map.grey.dtype == dtype
        assert not raster_map.grey.flags.writeable
        assert (raster_map.valid is None) != masked
        if masked:
            np.testing.assert_array_equal(raster_map.valid, valid)
    xy = first.to_map(np.random.default_rng(1).uniform(0, 100, (50, 2)))
    plain = RasterMap(grey, 0.1, Pose2(1.0, 2.0, 0.3), valid if masked else None)
    for found, expected in zip(again.sample(xy), plain.sample(xy), strict=True):
        np.testing.assert_array_equal(found, expected)


def test_a_negated_map_is_another(tmp_path, store):
    path = written(tmp_path)
    np.testing.assert_array_equal(load_map(path).grey, GREY)
    path.write_text(path.read_text().replace('negate: 0', 'negate: 1'))
    np.testing.assert_array_equal(load_map(path).grey, 255 - GREY)


def test_a_changed_picture_is_read_anew(tmp_path, store):
    path = written(tmp_path)
    load_map(path)
    save_map(RasterMap(255 - GREY, 0.1), path, force=True)
    np.testing.assert_array_equal(load_map(path).grey, 255 - GREY)


def test_small_maps_are_not_stored(tmp_path, store, monkeypatch):
    monkeypatch.setattr(map_store, 'LARGE', GREY.size)
    assert load_map(written(tmp_path)).grey.flags.writeable
    assert not store.exists()


def test_where_nothing_can_be_written_the_map_stays_in_memory(tmp_path, store):
    store.parent.parent.mkdir(parents=True)
    store.parent.write_text('a file in the way')
    np.testing.assert_array_equal(load_map(written(tmp_path)).grey, GREY)


def test_an_entry_cut_off_is_not_believed(tmp_path, store):
    path = written(tmp_path)
    load_map(path)
    (entry,) = store.iterdir()
    whole = (entry / 'grey.npy').read_bytes()
    (entry / 'grey.npy').write_bytes(whole[: len(whole) // 2])
    np.testing.assert_array_equal(load_map(path).grey, GREY)


def test_the_oldest_maps_make_room(tmp_path, store, monkeypatch):
    monkeypatch.setattr(map_store, 'MOST_BYTES', int(2.5 * GREY.size))
    for k in range(4):
        load_map(written(tmp_path, np.roll(GREY, k, axis=0), name=f'map{k}'))
        for entry in store.iterdir():  # age what is there
            seconds = entry.stat().st_mtime - 100.0
            os.utime(entry, (seconds, seconds))
    assert len(list(store.iterdir())) == 2
    assert not [e for e in store.iterdir() if e.name.startswith('.')]


def test_a_crop_takes_the_memory_of_the_crop(tmp_path, store):
    grey = np.tile(GREY, (30, 30))
    raster_map = load_map(written(tmp_path, grey))
    middle = raster_map.to_map(np.array([[1000, 1000], [1100, 1100]]))
    tracemalloc.start()
    crop = raster_map.crop(middle, margin=1.0, cell=0.1)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert crop is not None
    assert peak < 0.05 * grey.size
    raster_map.release()
    np.testing.assert_array_equal(raster_map.grey[:50, :50], grey[:50, :50])


def test_memory_given_back_is_not_resident(tmp_path, store):
    psutil = pytest.importorskip('psutil')
    grey = np.tile(GREY, (60, 60))
    raster_map = load_map(written(tmp_path, grey))
    raster_map.release()
    process = psutil.Process()
    before = process.memory_info().rss
    assert raster_map.grey.sum(dtype=np.int64) == grey.sum(dtype=np.int64)
    grown = process.memory_info().rss - before
    raster_map.release()
    left = process.memory_info().rss - before
    assert grown > 0.8 * grey.size
    assert left < 0.2 * grey.size


def test_the_part_about_a_place_leaves_the_rest_on_disk(tmp_path, store):
    psutil = pytest.importorskip('psutil')
    raster_map = load_map(written(tmp_path, np.tile(GREY, (60, 60))))
    crops, grid = MapCrops(raster_map), Grid(10.0, 4.0, 50, 40, 0.2)
    process = psutil.Process()
    before = process.memory_info().rss
    assert raster_map.grey.max() > 0  # the whole map is mapped
    middle = raster_map.origin @ Pose2(0.5 * raster_map.size_m[0], 0.5 * raster_map.size_m[1], 0.0)
    assert crops.about(grid, middle, SearchWindow(1.0, 1.0, 0.1, 0.05, 0.5), 0.1) is not None
    assert process.memory_info().rss - before < 0.4 * raster_map.grey.size
