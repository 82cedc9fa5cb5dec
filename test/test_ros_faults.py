# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""An error that nobody foresaw costs the frame and not the node."""

from __future__ import annotations

from functools import partial
import threading

import pytest

pytest.importorskip('rclpy')

from message_samples import odometry_message
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import camera_info, parameters, SECOND, START

from gip_localizer.core.estimate import Status
from gip_localizer.core.guard import run_guarded
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.threads import WorkEndedError
from gip_localizer.parameters import Parameters
from gip_localizer.ros.conversions import mono8
from gip_localizer.ros.localizer.localization import Localization
from gip_localizer.ros.localizer.worker import Worker
from gip_localizer.session.dispatch import CAMERA_INFO, IMAGE, ODOMETRY

pytestmark = pytest.mark.ros


@pytest.fixture
def localization(tester, map_file):
    """The working part of the node, on the tester's own node."""
    localization = Localization(tester, Parameters.from_dict(parameters(map_file)))
    yield localization
    localization.close()


def test_a_frame_that_raises_is_told_and_the_next_one_gives_a_pose(
    localization, render, monkeypatch
):
    told = []
    monkeypatch.setattr(
        localization._outputs, 'publish', lambda estimate, *_: told.append(estimate)
    )
    localization._take(CAMERA_INFO, camera_info())
    update = Localizer.update

    def localize(stamp):
        localization._take(IMAGE, mono8(stamp, 'camera', render(START)))

    monkeypatch.setattr(Localizer, 'update', lambda *_, **__: 1 / 0)
    localize(SECOND)
    monkeypatch.setattr(Localizer, 'update', update)
    localize(2 * SECOND)
    assert [estimate.status for estimate in told] == [Status.FAULT, Status.TRACKING]
    assert 'ZeroDivisionError' in told[0].reason
    assert told[0].pose is None


def test_what_came_during_a_search_is_taken_in_its_order_and_before_the_newest_image(tester):
    worker, done, may_end = Worker(tester), [], threading.Event()
    worker.start(may_end.wait, lambda _: done.append('search'))
    for n in range(3):
        worker.when_free(partial(done.append, f'odometry {n}'))
        worker.when_free(partial(done.append, f'image {n}'), instead_of='image')
    worker.when_free(partial(done.append, 'odometry 3'))
    assert done == []
    may_end.set()
    tester.until(lambda: len(done) == 6, 'the end of the work')
    assert done == ['search', *(f'odometry {n}' for n in range(4)), 'image 2']
    worker.close()


def test_an_odometry_message_that_raises_is_told_and_the_next_one_is_taken(
    localization, monkeypatch
):
    frontend, add = localization._dispatch.frontend, Localizer.add_odometry
    monkeypatch.setattr(Localizer, 'add_odometry', lambda *_: 1 / 0)
    localization._take(ODOMETRY, odometry_message(SECOND, START))
    assert 'ZeroDivisionError' in frontend.complaints['odom']
    monkeypatch.setattr(Localizer, 'add_odometry', add)
    localization._take(ODOMETRY, odometry_message(2 * SECOND, START))
    assert 'odom' not in frontend.complaints


def test_the_end_of_the_process_is_no_fault():
    def ended():
        raise WorkEndedError

    with pytest.raises(WorkEndedError):
        run_guarded(ended, SECOND, pytest.fail)
