# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Fixtures that many tests share: worlds are slow to make, and nobody changes them."""

from __future__ import annotations

from gip_localizer.core.threads import use_one_library_thread

# Before NumPy and OpenCV are loaded: as in the node, and parallel workers need the cores.
use_one_library_thread()

from drive_samples import drive, whole  # noqa: E402, F401 - fixtures
from hypothesis import HealthCheck, settings  # noqa: E402
import pytest  # noqa: E402
from road_samples import Road  # noqa: E402

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


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the demo, which mostly waits: at the end one worker would wait for it alone."""
    items.sort(key=lambda item: 'test_cli_demo' not in item.nodeid)
