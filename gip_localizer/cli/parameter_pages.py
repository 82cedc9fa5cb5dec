# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Generated pages: parameter files, and tables of parameters and diagnostics."""

from __future__ import annotations

from gip_localizer.parameters import Parameters
from gip_localizer.parameters.integration import BagPlayerParameters
from gip_localizer.parameters.ros_yaml import dump_ros_yaml
from gip_localizer.parameters.spec import ParameterGroup, Spec, Value
from gip_localizer.session.diagnostic_rules import DIAGNOSTIC_GROUPS
from gip_localizer.synthetic.parameters import CameraNodeParameters

TREES: dict[str, type[ParameterGroup]] = {
    'localizer': Parameters,
    'synthetic_camera': CameraNodeParameters,
    'bag_player': BagPlayerParameters,
}


PARAMETERS_PAGE = """# Parameters

Written by `make params`. Parameters marked *fixed* are read at start; all others can be changed
while the node runs, one by one or together (`set_parameters_atomically`). A bad value is refused
with its reason and the old one stays. `config/localizer.yaml` and `config/synthetic_camera.yaml`
hold all defaults.
"""
DIAGNOSTICS_PAGE = """# Diagnostics of `localizer`

Written by `make params`. `/diagnostics` carries one status per group, once a second and whenever
one changes. The message names every rule that holds, the most important first; otherwise it
begins with OK. The last column says whether poses are withheld meanwhile.

"""


def generated_pages() -> dict[str, str]:
    """Return every generated file of the source tree: path below the root → text."""
    pages = {
        f'config/{node}.yaml': parameter_file(tree_of(node))
        for node in ('localizer', 'synthetic_camera')
    }
    tables = [f'\n## `{node}`\n\n{markdown_table(tree)}\n' for node, tree in TREES.items()]
    pages['docs/parameters.md'] = PARAMETERS_PAGE + ''.join(tables)
    pages['docs/diagnostics.md'] = f'{DIAGNOSTICS_PAGE}{diagnostics_table()}\n'
    return pages


def tree_of(node: str) -> type[ParameterGroup]:
    """Return the parameters of a node by its name."""
    return TREES[node]


def parameter_file(tree: type[ParameterGroup]) -> str:
    """Return all defaults as a ROS parameter file, with the meaning of each line as a comment."""
    values = {spec.name: spec.default for spec in tree.specs()}
    lines = dump_ros_yaml(values).splitlines()
    # The dump keeps the order of the specs, so its leaves correspond to the specs one by one.
    remaining = iter(tree.specs())
    return '\n'.join(
        line if line.endswith(':') else f'{line}  # {_meaning(next(remaining))}' for line in lines
    ) + '\n'


def markdown_table(tree: type[ParameterGroup]) -> str:
    """Return the table of name, default, unit, allowed values and meaning."""
    rows = [
        '| parameter | default | unit | allowed | meaning |', '| --- | --- | --- | --- | --- |',
    ]  # fmt: skip
    for spec in tree.specs():
        fixed = ' *fixed*' if spec.read_only else ''
        rows.append(
            f'| `{spec.name}` | {_code(spec.default)} | {spec.unit} | {_range(spec)} '
            f'| {spec.description}{fixed} |'
        )
    return '\n'.join(rows)


def diagnostics_table() -> str:
    """Return all rules, then all figures, as Markdown."""
    rows = ['| status | message | level | when | pose |', '| --- | --- | --- | --- | --- |']
    rows += [
        f'| {group.name} | `{rule.name}` | {rule.level.name} | {rule.when} '
        f'| {"withheld" if rule.withheld else "published"} |'
        for group in DIAGNOSTIC_GROUPS for rule in group.rules
    ]  # fmt: skip
    rows += ['', '| status | key | unit | meaning |', '| --- | --- | --- | --- |']
    rows += [
        f'| {group.name} | `{key}` | {unit} | {meaning} |'
        for group in DIAGNOSTIC_GROUPS for key, (unit, meaning) in group.figures.items()
    ]  # fmt: skip
    return '\n'.join(rows)


def _meaning(spec: Spec) -> str:
    unit = f' [{spec.unit}]' if spec.unit else ''
    return f'{spec.description}{unit}'


def _code(value: Value) -> str:
    if isinstance(value, bool):
        return f'`{str(value).lower()}`'
    if isinstance(value, float):
        return f'`{value:.6g}`'
    return f'`{value!r}`' if value == '' else f'`{value}`'


def _range(spec: Spec) -> str:
    if spec.choices:
        return ', '.join(spec.choices)
    if spec.low is None and spec.high is None:
        return ''
    low = '' if spec.low is None else f'{spec.low:g}'
    high = '' if spec.high is None else f'{spec.high:g}'
    return f'{low} … {high}'
