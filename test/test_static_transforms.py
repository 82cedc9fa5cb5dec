# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The camera's pose from the static transforms, against SciPy's rotations."""

from __future__ import annotations

import math
from types import SimpleNamespace as Message

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.io.static_transforms import StaticTransforms, TransformError

ANGLE = st.floats(-1.4, 1.4)
LENGTH = st.floats(-5.0, 5.0)


def transform(parent, child, xyz, rotation):
    x, y, z, w = rotation.as_quat()
    return Message(
        header=Message(frame_id=parent), child_frame_id=child,
        transform=Message(
            translation=Message(x=xyz[0], y=xyz[1], z=xyz[2]),
            rotation=Message(x=x, y=y, z=z, w=w),
        ),
    )  # fmt: skip


def optical(extrinsics):
    return Rotation.from_matrix(extrinsics.rotation())


@given(LENGTH, LENGTH, LENGTH, ANGLE, ANGLE, ANGLE)
def test_extrinsics_survive_the_way_through_two_transforms(x, y, z, roll, pitch, yaw):
    wanted = Extrinsics(x, y, z, roll, pitch, yaw)
    mount = Rotation.from_euler('xyz', [0.3, -0.2, 1.0])
    offset = np.array([0.5, -1.0, 2.0])
    rest = mount.inv() * optical(wanted)
    tree = StaticTransforms()
    tree.take([
        transform('mount', 'camera_optical', mount.inv().apply([x, y, z] - offset), rest),
        transform('base_link', 'mount', offset, mount),
    ])  # fmt: skip
    found = tree.extrinsics('base_link', 'camera_optical')
    assert list(vars(found).values()) == pytest.approx(list(vars(wanted).values()), abs=1e-9)


def test_a_base_beside_the_camera_in_the_tree_is_reached_over_their_parent():
    wanted = Extrinsics(1.0, 0.2, 1.5, 0.0, 0.2, 0.0)
    tree = StaticTransforms()
    tree.take([
        transform('chassis', 'base_link', [0.0, 0.0, -0.3], Rotation.identity()),
        transform('/chassis', '/camera', [1.0, 0.2, 1.2], optical(wanted)),
    ])  # fmt: skip
    found = tree.extrinsics('base_link', 'camera')
    assert (found.z, found.pitch) == pytest.approx((1.5, 0.2))


def test_frames_that_are_not_connected_are_refused_by_name():
    tree = StaticTransforms()
    tree.take([transform('base_link', 'lidar', [0.0] * 3, Rotation.identity())])
    with pytest.raises(TransformError, match=r"'camera'.*known frames: lidar"):
        tree.extrinsics('base_link', 'camera')


def test_a_ring_of_frames_ends():
    tree = StaticTransforms()
    tree.take([transform('a', 'b', [0.0] * 3, Rotation.identity()),
               transform('b', 'a', [0.0] * 3, Rotation.identity())])
    with pytest.raises(TransformError):
        tree.extrinsics('base_link', 'a')


@pytest.mark.parametrize('quaternion', [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.nan)])
def test_what_is_no_rotation_is_left_out_and_named_only_where_it_matters(quaternion):
    tree = StaticTransforms()
    bad = transform('base_link', 'bad', [0.0] * 3, Rotation.identity())
    bad.transform.rotation = Message(**dict(zip('xyzw', quaternion, strict=True)))
    good = transform('base_link', 'good', [0.0, 0.0, 1.0], Rotation.identity())
    tree.take([bad, good])
    assert tree.extrinsics('base_link', 'good').z == 1.0
    with pytest.raises(TransformError, match='base_link to bad was ignored'):
        tree.extrinsics('base_link', 'bad')
    tree.take([transform('base_link', 'bad', [0.0] * 3, Rotation.identity())])
    with pytest.raises(TransformError) as refused:
        tree.extrinsics('base_link', 'other')
    assert 'ignored' not in str(refused.value)


def test_what_moves_above_both_frames_does_not_move_the_camera():
    tree = StaticTransforms()
    tree.take([transform('base_link', 'camera', [1.0, 0.2, 1.5], Rotation.identity())])
    still = tree.extrinsics('base_link', 'camera')
    turned = Rotation.from_euler('z', 1.1)
    tree.take([transform('odom', 'base_link', [4e5, 5e6, 0.0], turned)])
    assert tree.extrinsics('base_link', 'camera') == still
