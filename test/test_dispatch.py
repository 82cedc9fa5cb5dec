# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""One message in, estimates out: what the node and the replay share."""

from __future__ import annotations

from types import SimpleNamespace as Message

from camera_samples import HELD
from message_samples import camera_info, image_message, initial_pose
import numpy as np
from scipy.spatial.transform import Rotation
from test_frontend import CALIBRATION, COVARIANCE, PARAMETERS, S, scene  # noqa: F401 - a fixture
from test_static_transforms import transform

from gip_localizer.core.estimate import Status
from gip_localizer.session.dispatch import (
    CAMERA_INFO,
    Dispatch,
    IMAGE,
    INITIAL_POSE,
    MASK,
    ODOMETRY,
)

TENTH = 100_000_000


class Run:
    """A dispatch, and the estimates that came out of it."""

    def __init__(self, road, truth, **settings) -> None:
        self.log: list[str] = []
        self.dispatch = Dispatch(road.map, PARAMETERS.replace(settings), self.log.append)
        self.estimates = []
        self.send(CAMERA_INFO, camera_info(CALIBRATION))
        self.send(INITIAL_POSE, initial_pose(truth, COVARIANCE))

    def send(self, role, message, now_ns=0):
        out = [estimate for _, estimate in self.dispatch.estimates(role, message, now_ns)]
        self.estimates += out
        return out


def image(pixels, stamp=S, frame='camera'):
    message = image_message(pixels, 'mono8', stamp_ns=stamp)
    message.header.frame_id = frame
    return message


def test_an_image_gives_its_estimate_and_all_else_gives_none(road, scene):  # noqa: F811
    truth, pixels = scene
    run = Run(road, truth)
    assert run.estimates == []
    [estimate] = run.send(IMAGE, image(pixels))
    assert estimate.status is Status.TRACKING
    assert estimate.stamp_ns == S


def test_an_image_waits_for_its_mask_and_is_localized_without_it_when_it_is_overdue(
    road, scene  # noqa: F811
):
    truth, pixels = scene
    run = Run(road, truth, **{'mask.from_topic': True, 'mask.timeout': 0.1})
    assert run.send(IMAGE, image(pixels, S), now_ns=0) == []
    [masked] = run.send(MASK, image(np.full_like(pixels, 255), S), now_ns=TENTH // 2)
    assert masked.stamp_ns == S
    assert run.send(IMAGE, image(pixels, S + TENTH), now_ns=TENTH) == []
    [late] = run.send(CAMERA_INFO, camera_info(CALIBRATION), now_ns=3 * TENTH)
    assert late.stamp_ns == S + TENTH
    assert run.send(IMAGE, image(pixels, S + 2 * TENTH), now_ns=3 * TENTH) == []
    assert [frame.stamp_ns for frame, _ in run.dispatch.rest()] == [S + 2 * TENTH]


def test_of_images_without_a_mask_a_live_caller_takes_the_newest(road, scene):  # noqa: F811
    truth, pixels = scene
    run = Run(road, truth, **{'mask.from_topic': True, 'mask.timeout': 0.1})
    for step in range(3):
        run.send(IMAGE, image(pixels, S + step * TENTH), now_ns=step)
    [newest] = run.dispatch.newest_overdue(10 * TENTH)
    assert newest.stamp_ns == S + 2 * TENTH
    assert run.dispatch.overtaken == 2


def test_an_unexpected_exception_costs_its_message_alone(road, scene):  # noqa: F811
    truth, pixels = scene
    run = Run(road, truth)
    [fault] = run.send(IMAGE, Message(header=image(pixels).header))  # no encoding, no data
    assert fault.status is Status.FAULT
    run.send(ODOMETRY, Message())
    assert 'fault of gip_localizer' in run.dispatch.first_complaints[ODOMETRY]
    assert run.dispatch.frontend.counts['odom_refused'] == 1
    assert sum('Traceback' in text for text in run.log) == 2
    [estimate] = run.send(IMAGE, image(pixels, S + TENTH))
    assert estimate.published


def test_the_first_complaint_of_a_role_is_kept(road, scene):  # noqa: F811
    truth, _ = scene
    run = Run(road, truth)
    for frame in ('moon', 'mars'):
        wrong = initial_pose(truth, COVARIANCE)
        wrong.header.frame_id = frame
        run.send(INITIAL_POSE, wrong)
    assert 'moon' in run.dispatch.first_complaints[INITIAL_POSE]
    assert 'mars' in run.dispatch.frontend.complaints[INITIAL_POSE]


def test_the_camera_is_where_transforms_have_it_over_several_hops_and_moves_with_them(
    road, scene  # noqa: F811
):
    truth, pixels = scene
    wrong = {f'camera.{name}': 0.5 for name in vars(HELD)}
    run = Run(road, truth, **wrong)
    places = []
    mount = run.dispatch.follow_transforms(places.append)
    [unplaced] = run.send(IMAGE, image(pixels, S, 'camera_optical'))
    assert unplaced.status is Status.NO_CALIBRATION
    assert "no transform connects 'base_link' and 'camera_optical'" in unplaced.reason
    optical = Rotation.from_matrix(HELD.rotation())
    at = [HELD.x, HELD.y, HELD.z]
    broken = transform('base_link', 'horn', [np.nan] * 3, Rotation.identity())
    mount.take([transform('base_link', 'mount', [0.0, 0.0, 0.4], Rotation.identity()), broken])
    mount.take([transform('mount', 'camera_optical', np.subtract(at, [0.0, 0.0, 0.4]), optical)])
    assert mount.fault == ''
    [with_camera] = run.send(IMAGE, image(pixels, S + TENTH, 'camera_optical'))
    assert with_camera.published
    mount.take([transform('base_link', 'mount', [0.0, 0.0, 0.9], Rotation.identity())])
    run.send(IMAGE, image(pixels, S + 2 * TENTH, 'camera_optical'))
    assert mount.extrinsics.z == HELD.z + 0.5
    assert len(places) == 2
