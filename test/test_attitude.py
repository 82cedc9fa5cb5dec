# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""z, roll and pitch of published poses, against SciPy's rotations."""

from __future__ import annotations

from types import SimpleNamespace as Message

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gip_localizer.parameters.integration import Attitude
from gip_localizer.session.attitude import AttitudeSource, Tilt, tilt_of

ANGLE = st.floats(-0.7, 0.7)


def pose(tilt, yaw):
    x, y, z, w = tilt.quaternion(yaw)
    return Message(position=Message(x=0.0, y=0.0, z=tilt.z),
                   orientation=Message(x=x, y=y, z=z, w=w))


@given(ANGLE, ANGLE, st.floats(-3.0, 3.0))
def test_a_tilt_survives_its_quaternion(roll, pitch, yaw):
    tilt = Tilt(40.0, roll, pitch)
    expected = Rotation.from_euler('ZYX', [yaw, pitch, roll]).as_quat()
    np.testing.assert_allclose(np.abs(expected @ tilt.quaternion(yaw)), 1.0, atol=1e-12)
    assert tilt_of(pose(tilt, yaw)) == pytest.approx(tilt, abs=1e-9)


def test_the_source_is_followed_once_it_has_spoken_and_others_are_not():
    source = AttitudeSource(Attitude(source='odom', z=5.0, roll=0.1, pitch=0.2))
    source.take('initialpose', pose(Tilt(90.0, 0.0, 0.0), 1.0))
    assert source.tilt == Tilt(5.0, 0.1, 0.2)
    source.take('odom', pose(Tilt(40.0, 0.01, -0.02), 1.0))
    source.take('odom', pose(Tilt(np.nan, 0.0, 0.0), 1.0))
    assert source.tilt == pytest.approx(Tilt(40.0, 0.01, -0.02))


def test_what_is_not_estimated_has_the_variance_of_the_parameters():
    planar = np.array([[4.0, 1.0, 0.5], [1.0, 9.0, 0.25], [0.5, 0.25, 2.0]])
    full = AttitudeSource(Attitude(sigma_z=30.0, sigma_tilt=3.0)).covariance(planar).reshape(6, 6)
    np.testing.assert_array_equal(full[np.ix_([0, 1, 5], [0, 1, 5])], planar)
    assert np.diag(full)[[2, 3, 4]].tolist() == [900.0, 9.0, 9.0]
    assert not full[2:5, [0, 1, 5]].any()
