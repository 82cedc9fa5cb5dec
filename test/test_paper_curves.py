# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulated figure: exact, sampled, printed."""

from itertools import product

import numpy as np
import pytest

from gip_localizer.errors import ParameterError
from gip_localizer.paper.curves import BAND_999, compute_curves, GAIN_AT
from gip_localizer.paper.exact import equal_error_amplitude, exact_error
from gip_localizer.paper.geometry import PaperCamera
from gip_localizer.paper.printed import printed_points
from gip_localizer.paper.squares import Squares, visible_squares
from gip_localizer.paper.standard_error import pair_law
from gip_localizer.paper.theory import unweighted_cdf, weighted_cdf

CAMERA = PaperCamera()
SQUARES = visible_squares(CAMERA)
EXACT = [
    (0.1, 4.770014e-01, 4.836773e-01),
    (1.0, 2.823068e-01, 3.412392e-01),
    (2.0, 1.256686e-01, 2.069417e-01),
    (5.0, 2.704943e-03, 2.150132e-02),
    (7.0, 8.552233e-05, 2.532467e-03),
    (10.0, 2.967811e-07, 4.553935e-05),
]


@pytest.fixture(scope='module')
def curves():
    return compute_curves(CAMERA, 2000, seed=0)


@pytest.mark.parametrize(('amplitude', 'generalized', 'standard'), EXACT)
def test_exact_values_to_six_digits(amplitude, generalized, standard):
    for flag, expected in ((True, generalized), (False, standard)):
        error = exact_error(amplitude, SQUARES, CAMERA.snr_constant, generalized=flag)
        assert f'{error:.6e}' == f'{expected:.6e}'


def small_squares():
    return Squares(np.array([40.0, 60.0]), np.array([3, 2]), np.array([8e-4, 1e-4]))


@pytest.mark.parametrize('generalized', [True, False])
@pytest.mark.parametrize('amplitude', [0.1, 3.0, 40.0])
def test_exact_is_the_mean_over_every_pair(generalized, amplitude):
    squares = small_squares()
    vectors = amplitude * np.array(list(product((-1.0, 1.0), repeat=5)))
    formula = weighted_cdf if generalized else unweighted_cdf
    every = formula(vectors[:, None], vectors[None], squares.gramian, CAMERA.snr_constant)
    exact = exact_error(amplitude, squares, CAMERA.snr_constant, generalized=generalized)
    assert exact == pytest.approx(every.mean(), rel=1e-10)
    law = pair_law(squares, generalized=generalized)
    spread = law.standard_error(amplitude, CAMERA.snr_constant, 1)
    assert spread == pytest.approx(every.std(), rel=1e-3)


def test_gain_at_equal_error(curves):
    assert curves.gains_db == pytest.approx((2.98, 2.90, 2.72), abs=0.005)
    for probability in GAIN_AT:
        for flag in (True, False):
            a = equal_error_amplitude(
                probability, SQUARES, CAMERA.snr_constant, generalized=flag
            )
            error = exact_error(a, SQUARES, CAMERA.snr_constant, generalized=flag)
            assert error == pytest.approx(probability, rel=1e-6)


def test_an_error_that_is_never_reached_has_no_amplitude():
    squares = small_squares()
    a = equal_error_amplitude(0.5**6, squares, CAMERA.snr_constant, generalized=True)
    assert np.isnan(a)


def test_printed_points_stray_by_their_own_sampling_error(curves):
    for curve in (curves.standard, curves.generalized):
        assert 0.95 <= curve.printed_rms <= 1.05


def test_printed_points_are_the_papers():
    amplitudes, standard, generalized = printed_points()
    np.testing.assert_allclose(amplitudes, np.arange(1, 101) / 10)
    assert (standard[9], generalized[9]) == (0.341178297, 0.282019378)
    assert (standard > generalized).all()


def test_samples_lie_in_their_band(curves):
    for curve in (curves.standard, curves.generalized):
        assert curve.outside == 0
        stray = (curve.sampled - curve.exact) / curve.error
        assert np.abs(stray).max() < BAND_999
        assert 0.7 < np.sqrt(np.mean(stray**2)) < 1.3


def test_same_seed_same_samples():
    first, again, other = (compute_curves(CAMERA, 50, seed=seed) for seed in (0, 0, 1))
    assert np.array_equal(first.standard.sampled, again.standard.sampled)
    assert not np.array_equal(first.standard.sampled, other.standard.sampled)


def test_another_camera_has_no_printed_points():
    curves = compute_curves(PaperCamera(square=40.0), 10, seed=0)
    assert not curves.is_paper
    assert np.isnan(curves.standard.printed).all()


@pytest.mark.parametrize(
    ('samples', 'seed', 'camera', 'message'),
    [
        (0, 0, CAMERA, 'samples is 0'),
        (1, -1, CAMERA, 'seed is -1'),
        (1, 0, PaperCamera(noise_density=1e9), 'lower --noise'),
        (1, 0, PaperCamera(noise_density=1e-9), 'raise --noise'),
    ],
)
def test_bad_input(samples, seed, camera, message):
    with pytest.raises(ParameterError, match=message):
        compute_curves(camera, samples, seed)
