# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's equations, against numeric differentiation, integration and simulation."""

import math

import numpy as np
import pytest
from scipy.integrate import dblquad

from gip_localizer.errors import ParameterError
from gip_localizer.paper.geometry import (
    depth_of_distance,
    depth_of_row,
    jacobian,
    PaperCamera,
    project,
)
from gip_localizer.paper.squares import seen_distances, visible_squares
from gip_localizer.paper.theory import (
    error_generalized,
    error_standard,
    footprint,
    snr,
    unweighted_cdf,
    weighted_cdf,
)

CAMERA = PaperCamera()


def test_depth_of_row_inverts_the_projection():
    z = np.array([50.0, 80.0, 200.0])
    _, y_tilde = project(CAMERA, np.zeros(3), z)
    np.testing.assert_allclose(depth_of_row(CAMERA, y_tilde), z, rtol=1e-12)


def test_jacobian_has_the_corrected_sign():
    step, x, z = 1e-3, 30.0, 120.0
    rows = [
        np.subtract(
            project(CAMERA, np.array(x + dx), np.array(z + dz)),
            project(CAMERA, np.array(x - dx), np.array(z - dz)),
        ) / (2 * step)
        for dx, dz in ((step, 0.0), (0.0, step))
    ]
    np.testing.assert_allclose(jacobian(CAMERA, x, z), rows, rtol=1e-6, atol=1e-14)
    assert jacobian(CAMERA, x, z)[1, 1] > 0.0


def test_footprint_is_the_integral_of_the_area_scale():
    def scale(z, x):
        return abs(np.linalg.det(jacobian(CAMERA, x, z)))

    area, _ = dblquad(scale, -10.0, 10.0, 70.0, 90.0)
    closed = footprint(CAMERA, np.array(20.0), np.array(70.0), np.array(90.0))
    assert float(closed) == pytest.approx(area, rel=1e-9)


def test_snr_falls_with_the_cube_of_depth():
    thin = [
        float(snr(CAMERA, np.array(2.0), footprint(CAMERA, np.array(1.0), z, z + 1e-3)))
        for z in (np.array(50.0), np.array(100.0))
    ]
    assert thin[0] / thin[1] == pytest.approx(8.0, rel=1e-3)


def test_field_of_view_covers_40_to_200_cm():
    assert seen_distances(CAMERA) == pytest.approx((40.0, 200.0), abs=1e-3)


def test_the_rule_gives_the_66_squares():
    squares = visible_squares(CAMERA)
    assert squares.counts.tolist() == [5, 5, 7, 7, 9, 9, 11, 13]
    assert squares.distances.tolist() == [40, 60, 80, 100, 120, 140, 160, 180]
    assert squares.total == 66 == len(squares.gramian)


def test_row_gramian_is_taken_at_depths_along_the_axis():
    edges = depth_of_distance(CAMERA, np.array([40.0, 60.0]))
    assert edges[0] == pytest.approx(
        40 * math.cos(CAMERA.theta) + 58.3095 * math.sin(CAMERA.theta)
    )
    expected = 10.0 * (1 / edges[0] ** 2 - 1 / edges[1] ** 2)
    assert visible_squares(CAMERA).row_gramian[0] == pytest.approx(expected, rel=1e-12)


def test_printed_forms_are_the_general_ones_for_equal_norms():
    rng = np.random.default_rng(3)
    weight = visible_squares(CAMERA).gramian
    truth, other = rng.choice([-2.0, 2.0], (2, 50, 66))
    args = truth, other, weight, CAMERA.snr_constant
    np.testing.assert_allclose(weighted_cdf(*args), error_generalized(*args), rtol=1e-9)
    np.testing.assert_allclose(unweighted_cdf(*args), error_standard(*args), rtol=1e-9)


def test_general_form_is_what_simulated_noise_does():
    rng = np.random.default_rng(4)
    weight, constant, trials = np.array([4.0, 1.0, 0.2]), 0.3, 200_000
    truth, other = np.array([1.0, -2.0, 3.0]), np.array([0.5, 1.5, -1.0])
    v = truth + rng.standard_normal((trials, 3)) / np.sqrt(constant * weight)
    for gram, formula in ((weight, error_generalized), (np.ones(3), error_standard)):
        wrong = ((v - other) ** 2 @ gram < (v - truth) ** 2 @ gram).mean()
        expected = float(formula(truth, other, weight, constant))
        assert wrong == pytest.approx(expected, abs=4 * math.sqrt(expected / trials))
        printed = weighted_cdf if formula is error_generalized else unweighted_cdf
        assert abs(wrong - float(printed(truth, other, weight, constant))) > 0.02


def test_equal_vectors_are_told_apart_by_a_coin():
    u = np.ones(66)
    weight = visible_squares(CAMERA).gramian
    assert float(weighted_cdf(u, u, weight, CAMERA.snr_constant)) == 0.5


@pytest.mark.parametrize(
    ('camera', 'message'),
    [
        ({'height': -1.0}, 'height is -1'),
        ({'noise_density': math.nan}, 'noise_density'),
        ({'fov_vertical_deg': 180.0}, 'between 0 and 180'),
        ({'pitch_deg': 10.0}, 'horizon'),
        ({'square': 900.0}, 'no whole square'),
        ({'square': 0.01}, 'rows of squares'),
    ],
)
def test_cameras_that_cannot_be(camera, message):
    with pytest.raises(ParameterError, match=message):
        visible_squares(PaperCamera(**camera))
