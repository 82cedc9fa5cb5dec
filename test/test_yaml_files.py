# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML that grows when it is read is refused at once, in one line, wherever a file is read."""

from __future__ import annotations

import time

import pytest

from gip_localizer.errors import LINE, MapError, ParameterError
from gip_localizer.io.map_files import load_map
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.parameters.yaml_files import MOST_BYTES, read_yaml, YamlFileError


def nested(kind: str, depth: int = 9, width: int = 9) -> str:
    """Aliases that refer to each other, so many levels deep."""
    lines = ['a0: &a0 ' + ('{k: lol}' if kind == 'merge' else '[lol, lol]')]
    for level in range(1, depth):
        names = ', '.join([f'*a{level - 1}'] * width)
        lines.append(f'a{level}: &a{level} ' + {
            'list': f'[{names}]', 'merge': f'{{<<: [{names}], k{level}: 1}}',
            'map': '{' + ', '.join(f'k{i}: *a{level - 1}' for i in range(width)) + '}',
        }[kind])
    return '\n'.join(lines) + '\n'


BOMBS = {
    'lists': nested('list') + 'image: *a8\nresolution: *a8\norigin: *a8\n',
    'maps': nested('map') + 'image: *a8\nresolution: 0.1\norigin: *a8\n',
    'merged maps': nested('merge'), 'itself': '&a [*a, *a]\n',
    'a long word': 'a: &a ' + 'x' * 9999 + '\nb: [' + ', '.join(['*a'] * 999) + ']\n',
}


@pytest.mark.parametrize('text', BOMBS.values(), ids=BOMBS)
@pytest.mark.parametrize(('load', 'error'), [
    (load_map, MapError), (load_parameter_file, ParameterError),
])
def test_aliases_that_expand_without_bound_are_refused_at_once(tmp_path, text, load, error):
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    started = time.process_time()
    with pytest.raises(error, match='its aliases expand to more than') as caught:
        load(path)
    assert time.process_time() - started < 5.0
    assert len(str(caught.value)) < len(str(path)) + 2 * LINE
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize('text', [
    'image: ' + 'x' * 50_000 + '\nresolution: 0.1\norigin: [' + '1, ' * 9000 + '1]\n',
    'image: a.png\nresolution: ' + 'y' * 50_000 + '\norigin: [0, 0, 0]\n',
    ', '.join(['[' * 40 + 'z' * 9000]), 'a: 2024-99-99\n', 'a: ' + '1' * 5000 + '\n', '[' * 20_000,
])
def test_of_what_was_found_one_line_is_quoted(tmp_path, text):
    path = tmp_path / 'file.yaml'
    path.write_text(text)
    for load, error in ((load_map, MapError), (load_parameter_file, ParameterError)):
        with pytest.raises(error) as caught:
            load(path)
        assert len(str(caught.value)) < len(str(path)) + 3 * LINE
        assert '\n' not in str(caught.value)


def test_a_parameter_of_any_size_is_quoted_in_one_line():
    with pytest.raises(ParameterError) as caught:
        Parameters.from_dict({'camera.z': ['x'] * 100_000})
    assert len(str(caught.value)) < 2 * LINE


def test_a_file_that_is_no_yaml_file_is_not_read_whole(tmp_path):
    path = tmp_path / 'map.yaml'
    path.write_bytes(b'a' * (MOST_BYTES + 1))
    with pytest.raises(MapError, match='is larger than'):
        load_map(path)


def test_aliases_of_modest_size_are_read(tmp_path):
    path = tmp_path / 'a.yaml'
    path.write_text('\ufeffbase: &b {x: 1}\nother: {<<: *b, y: 2}\nlist: [*b, *b]\n', 'utf-8')
    assert read_yaml(path)['other'] == {'x': 1, 'y': 2}
    path.write_text('')
    assert read_yaml(path) is None
    path.write_text('a: !!python/object/apply:os.system [exit]\n')
    with pytest.raises(YamlFileError, match='not valid YAML'):
        read_yaml(path)


def test_files_may_lie_at_home(tmp_path, monkeypatch):
    monkeypatch.setenv('HOME', str(tmp_path))
    (tmp_path / 'p.yaml').write_text('/**: {ros__parameters: {camera: {z: 2.5}}}\n')
    assert load_parameter_file('~/p.yaml').camera.z == 2.5
