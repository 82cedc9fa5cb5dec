# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest
import yaml

from gip_localizer.errors import ParameterError
from gip_localizer.parameters import dump_parameter_file, load_parameter_file, Parameters
from gip_localizer.parameters.ros_yaml import dump_ros_yaml, load_ros_yaml
from gip_localizer.parameters.spec import Spec
from gip_localizer.synthetic.parameters import SyntheticCameraParameters

SPECS = {spec.name: spec for spec in Parameters.specs()}
TREES = [Parameters, SyntheticCameraParameters]
PUBLIC = [
    'map_file', 'image_transport', 'frames.map', 'frames.odom', 'frames.base', 'camera.x',
    'camera.y', 'camera.z', 'camera.roll', 'camera.pitch', 'camera.yaw', 'initial_pose.set',
    'initial_pose.x', 'initial_pose.y', 'initial_pose.yaw', 'birdseye.near', 'birdseye.far',
    'birdseye.half_width', 'birdseye.resolution', 'search.x', 'search.y', 'search.yaw',
    'search.yaw_step', 'score.metric',
]


def test_the_names_that_users_rely_on_are_there():
    assert set(PUBLIC) <= set(SPECS)
    assert SPECS['score.metric'].choices == (
        'gip', 'gip_normalized', 'euclidean', 'euclidean_normalized'
    )
    assert SPECS['image_transport'].choices == ('raw', 'compressed', 'foxglove')


@pytest.mark.parametrize('tree', TREES)
def test_every_parameter_says_what_it_is_and_its_default_is_allowed(tree):
    for spec in tree.specs():
        assert spec.description.endswith('.'), spec.name
        assert spec.checked(spec.default) == spec.default
        assert spec.type in (bool, int, float, str)
        if spec.type in (int, float):
            assert spec.low is not None, spec.name
            assert spec.high is not None, spec.name


def test_what_shapes_the_match_can_change_while_the_node_runs():
    for name, spec in SPECS.items():
        shapes = name.startswith(('birdseye.', 'search.', 'score.', 'camera.'))
        if shapes and name != 'camera.from_tf':
            assert not spec.read_only, name


@pytest.mark.parametrize('tree', TREES)
def test_parameters_come_back_from_a_file(tree, tmp_path):
    values = tree().to_dict()
    assert tree.from_dict(values) == tree()
    path = tmp_path / 'p.yaml'
    path.write_text(dump_ros_yaml(values), encoding='utf-8')
    loaded = load_ros_yaml(path)
    assert loaded == values
    assert {k: type(v) for k, v in loaded.items()} == {k: type(v) for k, v in values.items()}


@given(
    st.fixed_dictionaries({}, optional={
        'camera.pitch': st.floats(-1.6, 1.6), 'search.x': st.floats(0.0, 5.0),
        'search.yaw': st.floats(0.0, 0.5), 'birdseye.half_width': st.floats(0.1, 10.0),
        'integrity.lost_after': st.integers(1, 10000), 'score.robust': st.booleans(),
        'map_file': st.text(st.characters(codec='utf-8', exclude_categories=['Cs']), max_size=20),
        'score.metric': st.sampled_from(SPECS['score.metric'].choices),
    })
)
def test_any_allowed_values_come_back_from_a_file(tmp_path, values):
    parameters = Parameters.from_dict(values)
    path = tmp_path / 'p.yaml'
    path.write_bytes(dump_parameter_file(parameters).encode())
    assert load_parameter_file(path) == parameters


def test_what_is_not_named_keeps_its_value_and_the_original_stays():
    base = Parameters.from_dict({'search.x': 1.5, 'camera.z': 2.0})
    changed = base.replace({'search.x': 0.5})
    assert (changed.search.x, changed.camera.z, changed.search.y) == (0.5, 2.0, base.search.y)
    assert base.search.x == 1.5
    with pytest.raises(AttributeError):
        base.search.x = 3.0


def test_an_integer_is_a_number_but_not_the_other_way_round():
    assert Parameters.from_dict({'search.x': 1}).search.x == 1.0
    assert isinstance(Parameters.from_dict({'search.x': 1}).search.x, float)
    with pytest.raises(ParameterError, match='an integer'):
        Parameters.from_dict({'integrity.lost_after': 5.0})


def test_numbers_of_numpy_are_numbers():
    found = Parameters.from_dict({
        'camera.z': np.float64(1.25), 'search.x': np.float32(0.5),
        'integrity.lost_after': np.int64(7),
    })
    assert [type(found.camera.z), type(found.search.x)] == [float, float]
    assert type(found.integrity.lost_after) is int
    with pytest.raises(ParameterError, match=r'camera\.z'):
        Parameters.from_dict({'camera.z': np.float64('nan')})


@pytest.mark.parametrize(('name', 'suggestion'), [
    ('serach.x', 'search.x'), ('search.yawstep', 'search.yaw_step'),
    ('score.metrics', 'score.metric'), ('camera.hight', 'camera'),
    ('Birdseye.near', 'birdseye.near'),
])
def test_an_unknown_name_is_refused_with_the_nearest(name, suggestion):
    with pytest.raises(ParameterError, match=f'{name} is unknown; did you mean {suggestion}'):
        Parameters.from_dict({name: 1.0})


def test_a_name_like_no_other_is_refused_without_a_guess():
    with pytest.raises(ParameterError, match=r'parameter qqqq is unknown$'):
        Parameters.from_dict({'qqqq': 1})


@pytest.mark.parametrize(('name', 'value', 'expected'), [
    ('search.x', -0.1, 'from 0 to 1000 m'),
    ('search.x', math.nan, 'a number'),
    ('search.x', math.inf, 'a number'),
    ('search.x', '1.0', "got '1.0', expected a number"),
    ('search.x', True, 'got True'),
    ('search.x', None, 'got None'),
    ('search.x', [1.0], r'got \[1\.0\]'),
    ('search.yaw_step', 0.0, 'from 0.0001 to 0.5 rad'),
    ('birdseye.resolution', -0.05, 'from 0 to 2 m'),
    ('birdseye.resolution', 0.0005, 'at least 0.001 m, or 0: automatic'),
    ('camera.z', 0.0, 'from 0.01'),
    ('camera.pitch', 90.0, 'rad'),
    ('score.metric', 'ssd', 'one of gip, gip_normalized, euclidean'),
    ('score.metric', 3, 'one of gip'),
    ('score.robust', 1, 'true or false'),
    ('score.robust', 'true', 'true or false'),
    ('integrity.lost_after', True, 'an integer'),
    ('integrity.lost_after', 0, 'an integer from 1'),
    ('frames.map', 7, 'a string'),
])
def test_a_bad_value_is_refused_with_what_was_expected(name, value, expected):
    with pytest.raises(ParameterError, match=expected) as caught:
        Parameters.from_dict({name: value})
    assert name in str(caught.value)


VIEW = {
    'birdseye.near': 2.5, 'birdseye.far': 12.5, 'birdseye.half_width': 4.0,
    'birdseye.resolution': 0.05,
}


def test_a_value_of_the_view_is_automatic_where_it_is_zero():
    assert Parameters().birdseye.automatic == ('near', 'far', 'half_width', 'resolution')
    assert Parameters.from_dict({'birdseye.far': 8.0}).birdseye.automatic == (
        'near', 'half_width', 'resolution'
    )
    assert Parameters.from_dict(VIEW).birdseye.automatic == ()


@pytest.mark.parametrize(('values', 'word'), [
    ({**VIEW, 'birdseye.near': 13.0}, r'birdseye\.far .* must exceed birdseye\.near'),
    ({**VIEW, 'birdseye.far': 2.55}, 'at least two cells'),
    ({'birdseye.half_width': 0.05, 'birdseye.resolution': 0.5}, 'half_width'),
    ({**VIEW, 'birdseye.resolution': 0.001}, 'more than 4e'),
    ({'search.x': 1000.0, 'search.y': 1000.0}, 'candidates'),
    ({'search.yaw': 3.14, 'search.yaw_step': 0.0001, 'search.x': 30.0}, 'candidates'),
])
def test_rules_across_parameters(values, word):
    with pytest.raises(ParameterError, match=word):
        Parameters.from_dict(values)


def test_a_refused_set_changes_nothing():
    base = Parameters()
    with pytest.raises(ParameterError):
        base.replace({'search.y': 2.0, 'search.x': -1.0})
    assert base == Parameters()


@pytest.mark.parametrize(('text', 'word'), [
    ('', 'no "ros__parameters"'),
    ('- a\n', 'no "ros__parameters"'),
    ('search:\n  x: 1.0\n', 'no "ros__parameters"'),
    ('localizer:\n  ros__parameters: 3\n', 'no "ros__parameters"'),
    ('localizer:\n  ros__parameters:\n    search: [\n', 'parameter file'),
    ('localizer:\n  ros__parameters:\n    search:\n      x: wide\n', "got 'wide'"),
    ('localizer:\n  ros__parameters:\n    serach.x: 1.0\n', 'did you mean search.x'),
    ('localizer:\n  ros__parameters:\n    search: 3\n', 'parameter search is unknown'),
    ('localizer:\n  ros__parameters:\n    1: 3\n', 'parameter 1 is unknown'),
    ('x: !!python/object/apply:os.getcwd []\n', 'parameter file'),
    ('[' * 700, 'parameter file'),
])
def test_a_bad_parameter_file_is_refused_by_name(tmp_path, text, word):
    path = tmp_path / 'p.yaml'
    path.write_text(text, encoding='utf-8')
    with pytest.raises(ParameterError, match=word) as caught:
        load_parameter_file(path)
    assert str(path) in str(caught.value)


def test_a_file_that_cannot_be_read_is_refused(tmp_path):
    with pytest.raises(ParameterError, match=r'none\.yaml'):
        load_parameter_file(tmp_path / 'none.yaml')
    (tmp_path / 'binary.yaml').write_bytes(b'\xff\xfe\x00\x80' * 20)
    with pytest.raises(ParameterError, match=r'binary\.yaml'):
        load_parameter_file(tmp_path / 'binary.yaml')


def test_dotted_and_nested_names_in_a_file_are_the_same(tmp_path):
    path = tmp_path / 'p.yaml'
    path.write_text('/**:\n  ros__parameters:\n    search.x: 0.5\n    search: {y: 0.25}\n')
    loaded = load_parameter_file(path)
    assert (loaded.search.x, loaded.search.y) == (0.5, 0.25)


def test_numbers_in_a_written_file_keep_their_point():
    # rclpy refuses 4 where it declared 4.0.
    text = dump_parameter_file(Parameters.from_dict({'search.x': 4, 'camera.z': 1e-2}))
    values = yaml.safe_load(text)['/**']['ros__parameters']
    assert isinstance(values['search']['x'], float)
    assert isinstance(values['camera']['z'], float)
    assert ': 4\n' not in text


@given(st.floats(-1e6, 1e6), st.floats(-10, 10), st.floats(0, 10))
def test_bounds_are_inclusive(value, low, span):
    spec = Spec('a.b', low, 'm', 'A.', low, low + span)
    if low <= value <= low + span:
        assert spec.checked(value) == value
    else:
        with pytest.raises(ParameterError):
            spec.checked(value)
    assert spec.checked(low) == low
    assert spec.checked(low + span) == low + span


def test_a_parameter_file_that_is_no_yaml_is_refused_in_one_line(tmp_path):
    (tmp_path / 'p.yaml').write_text('a: b: c')
    with pytest.raises(ParameterError, match=r'^[^\n]*; expected a ROS parameter YAML[^\n]*$'):
        load_parameter_file(tmp_path / 'p.yaml')
