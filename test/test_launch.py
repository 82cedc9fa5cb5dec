# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The launch files name what exists.

They are read as text, since `launch` comes with a ROS installation only; where there is one they
are evaluated too.

"""

from __future__ import annotations

import ast
from pathlib import Path
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest
from test_config import named_topics

from gip_localizer.parameters import Parameters
from gip_localizer.synthetic.parameters import CameraNodeParameters

ROOT = Path(__file__).parents[1]
FILES = sorted((ROOT / 'launch').glob('*.launch.py'))
KINDS = {'localizer': Parameters, 'synthetic_camera': CameraNodeParameters}
OF_EVERY_NODE = {'use_sim_time'}


def tree(path):
    return ast.parse(path.read_text())


def calls(path, name):
    """Keyword arguments, and the positional ones, of each call of a function."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Call) and getattr(node.func, 'id', '') == name:
            yield {keyword.arg: keyword.value for keyword in node.keywords}, node.args


def nodes(path):
    """What each `Node` of this package is given."""
    for given, _ in calls(path, 'Node'):
        if ast.literal_eval(given['package']) == 'gip_localizer':
            yield ast.literal_eval(given['executable']), given


def literal(path, name):
    """The value of a constant of the file."""
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Assign) and getattr(node.targets[0], 'id', '') == name:
            return node.value
    return None


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_nodes_and_parameters_exist(path):
    found = list(nodes(path))
    assert found
    for executable, given in found:
        assert (ROOT / 'resource' / 'executables' / executable).is_file()
        known = {spec.name for spec in KINDS[executable].specs()} | OF_EVERY_NODE
        for part in ast.walk(given['parameters']):
            if isinstance(part, ast.Dict):
                names = {ast.literal_eval(key) for key in part.keys if key is not None}
                assert names <= known


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_files_exist_and_only_the_map_of_the_demo_is_required(path):
    named = {node.value for node in ast.walk(tree(path)) if isinstance(node, ast.Constant)
             and isinstance(node.value, str)}
    for name in named:
        if name.endswith(('.xml', '.rviz')) or name == 'localizer.yaml':
            assert (ROOT / 'config' / name).is_file(), name
    required = [ast.literal_eval(args[0]) for given, args in calls(path, 'DeclareLaunchArgument')
                if 'default_value' not in given]
    assert required == (['map_file'] if path.name == 'demo.launch.py' else [])


def test_every_topic_can_be_remapped():
    topics = set(ast.literal_eval(literal(ROOT / 'launch' / 'localizer.launch.py', 'TOPICS')))
    relative = {name for way in ('in', 'out') for name in named_topics(way)
                if not name.startswith(('~', '/'))}
    assert topics == relative


def test_what_is_laid_over_the_parameter_file_is_a_parameter_and_empty_by_default():
    path = ROOT / 'launch' / 'localizer.launch.py'
    laid = ast.literal_eval(literal(path, 'OF_THE_FILE'))
    assert set(laid) <= {spec.name for spec in Parameters.specs()} | OF_EVERY_NODE
    arguments = literal(path, 'ARGUMENTS')
    defaults = {ast.literal_eval(key): value.elts[0] for key, value in
                zip(arguments.keys, arguments.values, strict=True)}
    assert [ast.literal_eval(defaults[name]) for name in laid] == [''] * len(laid)


def test_rviz_looks_where_the_topics_of_the_node_are():
    path = ROOT / 'launch' / 'localizer.launch.py'
    [rviz] = [given for given, _ in calls(path, 'Node')
              if ast.literal_eval(given['package']) == 'rviz2']
    [(_, localizer)] = nodes(path)
    assert ast.unparse(rviz['namespace']) == ast.unparse(localizer['namespace'])
    rules = ast.unparse(rviz['remappings'])
    assert "(f'/{topic}', given[topic]) for topic in TOPICS" in rules
    topics = ast.literal_eval(literal(path, 'TOPICS'))
    layout = (ROOT / 'config' / 'localizer.rviz').read_text()
    for name in set(re.findall(r'Value: /(\S+)', layout)) - {'map_updates'}:
        assert name in topics or f"('/{name}', '{name}')" in rules


def test_the_package_depends_on_what_the_files_import():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    depends = {item.text for item in manifest if item.tag in ('depend', 'exec_depend')}
    imported = {node.module.split('.')[0] for path in FILES for node in ast.walk(tree(path))
                if isinstance(node, ast.ImportFrom)} - {'pathlib'}
    provided = {'launch': 'ros2launch'}  # which depends on it
    assert {provided.get(name, name) for name in imported} <= depends


LAUNCHED = """
import sys
from launch import LaunchDescription, LaunchService
from launch.actions import IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource
path, *given = sys.argv[1:]
service = LaunchService(noninteractive=True)
service.include_launch_description(LaunchDescription([IncludeLaunchDescription(
    PythonLaunchDescriptionSource(path),
    launch_arguments=[tuple(one.split(':=')) for one in given],
)]))
sys.exit(service.run())
"""


@pytest.mark.parametrize(('given', 'words'), [
    ('rviz:=true', 'rviz2 is not installed'),
    ('params_file:=/nowhere.yaml', 'params_file /nowhere.yaml: no such file'),
    ('respawn:=perhaps', 'expected true or false'),
])
def test_launch_refuses_before_it_starts_a_process(given, words):
    installed('launch_ros')
    launched = run_launch(given)
    assert launched.returncode == 1
    assert words in launched.stdout + launched.stderr
    assert 'process started' not in launched.stdout + launched.stderr


def test_launch_leaves_the_parameter_file_its_word(tmp_path):
    """A map that does not exist ends the node at once, and names where the map came from."""
    installed('launch_ros')
    path = tmp_path / 'vehicle.yaml'
    path.write_text('/**:\n  ros__parameters:\n    map_file: /of/the/file.yaml\n')
    assert '/of/the/file.yaml' in run_launch(f'params_file:={path}').stdout
    given = run_launch(f'params_file:={path}', 'map_file:=/of/the/launch.yaml')
    assert '/of/the/launch.yaml' in given.stdout


def run_launch(*given):
    path = ROOT / 'launch' / 'localizer.launch.py'
    return subprocess.run(
        [sys.executable, '-c', LAUNCHED, str(path), *given],
        capture_output=True, text=True, timeout=60, check=False,
    )  # fmt: skip


def installed(module):
    pytest.importorskip(module)
    packages = pytest.importorskip('ament_index_python.packages')
    try:
        packages.get_package_share_directory('gip_localizer')
    except packages.PackageNotFoundError:
        pytest.skip('the package is not installed where ament looks')


@pytest.mark.parametrize('path', FILES, ids=lambda path: path.name)
def test_launch_itself_takes_them_where_it_is_installed(path):
    installed('launch_ros')
    sources = pytest.importorskip('launch.launch_description_sources')
    description = sources.get_launch_description_from_python_launch_file(str(path))
    assert 'map_file' in [argument.name for argument in description.get_launch_arguments()]
