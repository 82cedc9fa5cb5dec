# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The Fast DDS profile that the nodes set for large images, on Jazzy and on Kilted."""

from __future__ import annotations

from pathlib import Path
import xml.etree.ElementTree as ElementTree

import pytest

from gip_localizer.ros.middleware import image_environment, profile_path, PROFILES


@pytest.fixture(autouse=True)
def unset(monkeypatch):
    for name in PROFILES:
        monkeypatch.delenv(name, raising=False)


def test_the_variables_of_fast_dds_2_and_3_name_the_same_profile():
    given = image_environment()
    assert set(given) == {'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'}
    assert set(given.values()) == {str(profile_path())}
    root = ElementTree.parse(Path(given['FASTDDS_DEFAULT_PROFILES_FILE'])).getroot()
    assert [int(size.text) for size in root.iter() if size.tag.endswith('segment_size')] == [
        32 << 20
    ]


@pytest.mark.parametrize('name', PROFILES)
def test_a_profile_of_the_user_stays(monkeypatch, name):
    monkeypatch.setenv(name, '/etc/vehicle.xml')
    assert image_environment() == {}
