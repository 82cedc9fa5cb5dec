# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip params`, and that what it wrote is what lies in the tree."""

from pathlib import Path

import pytest

from gip_localizer.cli import main
from gip_localizer.cli.parameter_pages import generated_pages
from gip_localizer.parameters import load_parameter_file, Parameters
from gip_localizer.parameters.ros_yaml import load_ros_yaml
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS

ROOT = Path(__file__).parents[1]


@pytest.mark.parametrize('node', ['localizer', 'synthetic_camera'])
def test_the_parameter_file_in_the_tree_is_the_one_written_now(capsys, node):
    assert main(['params', '--node', node, '--yaml']) == 0
    assert (ROOT / 'config' / f'{node}.yaml').read_text() == capsys.readouterr().out


def test_the_generated_pages_in_the_tree_are_those_of_the_code():
    for name, text in generated_pages().items():
        assert (ROOT / name).read_text() == text, f'{name}: run `make params`'


def test_the_page_of_parameters_holds_the_table_that_is_printed(capsys):
    assert main(['params', '--markdown']) == 0
    assert capsys.readouterr().out.strip() in (ROOT / 'docs' / 'parameters.md').read_text()


def test_the_page_of_diagnostics_holds_every_rule():
    text = (ROOT / 'docs' / 'diagnostics.md').read_text()
    assert all(f'`{rule.name}`' in text for group in DIAGNOSTIC_GROUPS for rule in group.rules)


def test_the_parameter_file_holds_every_parameter_at_its_default():
    path = ROOT / 'config' / 'localizer.yaml'
    assert load_parameter_file(path) == Parameters()
    assert set(load_ros_yaml(path)) == {spec.name for spec in Parameters.specs()}


def test_each_line_of_the_parameter_file_tells_the_meaning_of_its_own_parameter():
    lines = (ROOT / 'config' / 'localizer.yaml').read_text().splitlines()
    for spec in Parameters.specs():
        leaf = spec.name.split('.')[-1]
        assert any(
            line.strip().startswith(f'{leaf}:') and spec.description in line for line in lines
        ), spec.name


def test_a_folder_that_is_no_source_tree_is_refused(tmp_path, capsys):
    assert main(['params', '--write', str(tmp_path)]) == 1
    assert 'package.xml' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_help_names_every_verb(capsys):
    with pytest.raises(SystemExit, match='0'):
        main(['--help'])
    assert 'demo' in capsys.readouterr().out
