# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""CameraInfo as drivers fill it: more numbers than the model takes, a scale left at zero."""

from __future__ import annotations

from camera_samples import EQUIDISTANT, make_calibration, PLUMB_BOB, RATIONAL
from message_samples import camera_info
import numpy as np
import pytest

from gip_localizer.errors import CalibrationError
from gip_localizer.io.messages import calibration, calibration_note


@pytest.mark.parametrize(('model', 'D', 'zeros'), [
    ('plumb_bob', PLUMB_BOB, 3), ('plumb_bob', PLUMB_BOB, 9), ('equidistant', EQUIDISTANT, 1),
    ('equidistant', EQUIDISTANT, 4), ('fisheye', EQUIDISTANT, 10),
    ('rational_polynomial', RATIONAL, 1), ('rational_polynomial', RATIONAL, 9),
])
def test_zeros_beyond_what_the_model_takes_are_left_out(model, D, zeros):
    made = make_calibration('none')
    read = calibration(camera_info(made, distortion_model=model, d=np.pad(D, (0, zeros))))
    np.testing.assert_array_equal(read.D[: D.size], D)
    assert not read.D[D.size :].any()
    assert read.model == model


def test_a_rational_model_of_few_numbers_is_plumb_bob():
    message = camera_info(make_calibration('none'), distortion_model='rational_polynomial',
                          d=PLUMB_BOB)
    assert calibration(message).key() == make_calibration('plumb_bob').key()


@pytest.mark.parametrize(('model', 'D', 'words'), [
    ('plumb_bob', np.append(PLUMB_BOB, [0.0, 0.0, 0.1]), 'D has 8 numbers; plumb_bob takes 4'),
    ('equidistant', np.append(EQUIDISTANT, 0.1), 'D has 5 numbers; equidistant takes 4'),
    ('plumb_bob', np.append(PLUMB_BOB, [np.nan, 0.0, 0.0]), 'NaN'),
    ('plumb_bob', PLUMB_BOB[:3], 'D has 3 numbers'),
    ('', PLUMB_BOB[:4], 'as of plumb_bob or equidistant;'),
    ('', PLUMB_BOB[:3], 'as of no model'),
])
def test_numbers_that_mean_something_else_are_named(model, D, words):
    with pytest.raises(CalibrationError, match=words):
        calibration(camera_info(make_calibration('none'), distortion_model=model, d=D))


@pytest.mark.parametrize('lens', ['plumb_bob', 'rational-8', 'rational-14'])
def test_numbers_of_one_model_alone_are_used_without_its_name_and_it_is_said(lens):
    made = make_calibration(lens)
    message = camera_info(made, distortion_model='')
    assert calibration(message).key() == made.key()
    assert f'{made.D.size} numbers of D are used as {made.model}' in calibration_note(message)


def test_a_lens_that_is_named_or_has_no_distortion_needs_no_note():
    for model, D in (('plumb_bob', PLUMB_BOB), ('', np.zeros(5)), ('', np.zeros(0))):
        assert not calibration_note(camera_info(make_calibration('none'), d=D,
                                                distortion_model=model))


def test_a_last_number_left_at_zero_is_one():
    made = make_calibration('plumb_bob', P=np.diag([400.0, 400.0, 1.0]))
    K, P = made.K.copy(), np.hstack([made.P, np.zeros((3, 1))])
    K[2, 2] = P[2, 2] = 0.0
    assert calibration(camera_info(made, k=K.ravel(), p=P.ravel())).key() == made.key()


def test_zeros_of_another_model_are_no_lens_and_those_of_the_fisheye_an_ideal_one():
    for D, model in ((np.zeros(5), 'plumb_bob'), (np.zeros(8), 'plumb_bob'),
                     (np.zeros(4), 'equidistant'), (np.zeros(0), 'equidistant')):
        message = camera_info(make_calibration('none'), distortion_model='equidistant', d=D)
        assert calibration(message).model == model
