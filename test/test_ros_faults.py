# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""An error that nobody foresaw costs the frame and not the node."""

from __future__ import annotations

from functools import partial
from itertools import count
import threading

import pytest

pytest.importorskip('rclpy')

from nav_msgs.msg import Odometry
from ros_scene import *  # noqa: F403 - fixtures and the world
from ros_scene import assert_near, camera_info, frames, parameters, SECOND, START

from gip_localizer.core.guard import run_guarded
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.threads import WorkEndedError
from gip_localizer.parameters import Parameters
from gip_localizer.ros.conversions import header_of, pose_of
from gip_localizer.ros.localizer.localization import Localization
from gip_localizer.ros.localizer.worker import Worker

pytestmark = pytest.mark.ros


@pytest.fixture
def localization(tester, map_file):
    """The working part of the node, on the tester's own node: it hears what the tester sends."""
    localization = Localization(tester, Parameters.from_dict(parameters(map_file)))
    tester.until(tester.matched, 'its own subscriptions')
    yield localization
    localization.close()


@pytest.mark.usefixtures('localization')
def test_a_frame_that_raises_is_told_and_the_next_one_gives_a_pose(tester, render, monkeypatch):
    images = frames(render(START))

    def until(condition, what):
        def shown():
            tester.info.publish(camera_info())
            tester.image.publish(next(images))
            tester.spin(0.1)
            return condition()

        tester.until(shown, what)

    with monkeypatch.context() as fault:
        fault.setattr(Localizer, 'update', lambda *_, **__: 1 / 0)
        until(lambda: tester.said('output', 'WITHHELD: FAULT: ZeroDivisionError'), 'the fault')
        assert not tester.poses
    until(lambda: tester.poses, 'a pose')
    assert_near(tester.poses[-1], START)


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


@pytest.mark.usefixtures('localization')
def test_an_odometry_message_that_raises_is_told_and_the_next_one_is_taken(tester, monkeypatch):
    stamps = count(SECOND, SECOND // 10)

    def until(condition, what):
        def sent():
            message = Odometry(header=header_of(next(stamps), 'odom'), child_frame_id='base_link')
            message.pose.pose = pose_of(START)
            tester.odom.publish(message)
            tester.spin(0.1)
            return condition()

        tester.until(sent, what)

    with monkeypatch.context() as fault:
        fault.setattr(Localizer, 'add_odometry', lambda *_: 1 / 0)
        until(lambda: tester.said('odometry', 'ZeroDivisionError'), 'the fault')
    until(lambda: not tester.said('odometry', 'ZeroDivisionError'), 'its end')


def test_the_end_of_the_process_is_no_fault():
    def ended():
        raise WorkEndedError

    with pytest.raises(WorkEndedError):
        run_guarded(ended, SECOND, pytest.fail)
