# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that many tests share: worlds are slow to make, and nobody changes them."""

from __future__ import annotations

from drive_samples import drive  # noqa: F401 - a fixture
from hypothesis import HealthCheck, settings
import pytest
from road_samples import Road

# Rendering and precomputing take as long as they take on a loaded machine.
settings.register_profile(
    'gip', deadline=None, derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
)
settings.load_profile('gip')


@pytest.fixture(scope='session')
def road() -> Road:
    """A road of 40 x 30 m whose map lies turned and shifted in the map frame."""
    return Road()
