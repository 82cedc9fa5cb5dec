# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What is said of a view: which it is, and with which numbers it would fit."""

from camera_samples import make_camera
import pytest

from gip_localizer.core.calibrated_view import CalibratedView
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Birdseye, Parameters
from gip_localizer.session.view_report import view_text, view_warnings

MAP = 0.05
GIVEN = {
    'birdseye.near': 3.0, 'birdseye.far': 10.0, 'birdseye.half_width': 3.0,
    'birdseye.resolution': 0.1,
}


def warnings(**changes):
    values = {**GIVEN, **{f'birdseye.{name}': value for name, value in changes.items()}}
    parameters = Parameters.from_dict(values)
    prepared = CalibratedView(make_camera(), parameters, MAP)
    return view_warnings(prepared, parameters.birdseye, MAP)


def test_the_text_names_the_view_and_what_was_chosen():
    view = Birdseye(0.6, 9.2, 3.1, 0.025)
    text = 'view 0.6 to 9.2 m ahead, 3.1 m to each side, cells of 2.5 cm: '
    assert view_text(view, Birdseye()) == text + 'chosen from camera and map'
    assert view_text(view, view) == text + 'as given'
    assert view_text(view, Birdseye(far=9.2)) == (
        text + 'near, half_width, resolution chosen from camera and map'
    )


def test_a_view_that_fits_is_not_warned_of():
    assert warnings() == {}


def test_a_view_mostly_outside_the_image_is_named_with_numbers_that_fit():
    [(rule, detail)] = warnings(near=-12.0).items()
    assert rule == 'VIEW_OUTSIDE_IMAGE'
    assert '% of the cells lie outside the image; birdseye.near ' in detail
    assert 'would fit' in detail


@pytest.mark.parametrize('near', [-90.0, -12.0])
def test_a_view_outside_the_image_is_refused_with_numbers_that_fit(near):
    far = near + 8.0 if near == -12.0 else 3.0
    with pytest.raises(CalibrationError, match='would fit'):
        warnings(near=near, far=far)


@pytest.mark.parametrize(('side', 'word'), [(0.02, 'finer'), (0.4, 'coarser')])
def test_cells_unlike_those_of_the_map_are_named(side, word):
    assert f'much {word} than those of the map, 0.05 m' in warnings(resolution=side)['VIEW_CELLS']
