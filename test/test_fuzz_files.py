# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Mutated map, mask, parameter and state files: read, or refused with an error that names the file.

`make fuzz` tries thousands of each, none of which may take longer than a second.

"""

from __future__ import annotations

import os
from pathlib import Path

import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
from mutations import mutated_bytes, no_hang
import numpy as np
import pytest

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import GipError
from gip_localizer.io.map_files import load_map, load_mask, save_map
from gip_localizer.parameters import dump_parameter_file, load_parameter_file, Parameters
from gip_localizer.session.pose_file import LastPose, load_state, save_state

MANY = settings(max_examples=int(os.environ.get('GIP_FUZZ', '100')))


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp('fuzz')


@pytest.fixture(scope='module')
def raster():
    grey = np.random.default_rng(5).integers(0, 255, (40, 60)).astype(np.uint8)
    return RasterMap(grey, 0.1, Pose2(1.0, 2.0, 0.3))


def attempt(read, path: Path, content: bytes):
    """Write, read; an error must be one of the package, and name the file."""
    path.write_bytes(content)
    try:
        with no_hang():
            return read(path)
    except GipError as error:
        assert path.name in str(error) or path.stem in str(error)  # noqa: PT017
        return None


@MANY
@given(data=st.data())
def test_mutated_map_yamls(folder, raster, data):
    good = folder / 'good.yaml'
    if not good.exists():
        save_map(raster, good)
    found = attempt(load_map, folder / 'good_fuzz.yaml', data.draw(mutated_bytes(
        good.read_bytes())))
    if found is not None:
        assert found.resolution > 0.0
        assert np.isfinite([*found.origin, *found.bounds]).all()


@MANY
@given(data=st.data())
def test_mutated_map_pictures(folder, raster, data):
    yaml = folder / 'picture.yaml'
    if not yaml.exists():
        save_map(raster, yaml)
        (folder / 'picture.keep').write_bytes((folder / 'picture.png').read_bytes())
    content = data.draw(mutated_bytes((folder / 'picture.keep').read_bytes()))
    found = attempt(lambda _: load_map(yaml), folder / 'picture.png', content)
    if found is not None:
        assert found.grey.ndim == 2


@MANY
@given(data=st.data(), suffix=st.sampled_from(['.png', '.pgm', '.jpg']))
def test_mutated_mask_files(folder, raster, data, suffix):
    good = cv2.imencode(suffix, np.where(raster.grey > 99, 255, 0).astype(np.uint8))[1].tobytes()
    found = attempt(load_mask, folder / f'mask_fuzz{suffix}', data.draw(mutated_bytes(good)))
    if found is not None:
        assert found.ndim == 2
        assert found.dtype == np.uint8


@MANY
@given(data=st.data())
def test_mutated_parameter_files(folder, data):
    content = data.draw(mutated_bytes(dump_parameter_file(Parameters()).encode()))
    found = attempt(load_parameter_file, folder / 'params.yaml', content)
    if found is not None:
        found.check()
        assert Parameters.from_dict(found.to_dict()) == found


@MANY
@given(data=st.data())
def test_mutated_state_files(folder, data):
    path = folder / 'state.json'
    state = LastPose('a' * 16, 'map', 1000.0, (1.0, 2.0, 0.1), tuple(np.eye(3).ravel()), 2.0)
    save_state(path, state)

    def read(where):
        return load_state(where, expected_hash='a' * 16, frame='map', now=1001.0, max_age=60.0)

    found = attempt(read, path, data.draw(mutated_bytes(path.read_bytes())))
    if found is not None:
        assert np.isfinite([*found.pose, *found.covariance, found.speed]).all()
