# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node on paper: a commented ROS parameter file and a Markdown table."""

from __future__ import annotations

from gip_localizer.parameters import Parameters
from gip_localizer.parameters.integration import BagPlayerParameters
from gip_localizer.parameters.spec import dump_ros_yaml, ParameterGroup, Spec, Value
from gip_localizer.synthetic.parameters import CameraNodeParameters

TREES: dict[str, type[ParameterGroup]] = {
    'localizer': Parameters,
    'synthetic_camera': CameraNodeParameters,
    'bag_player': BagPlayerParameters,
}


def tree_of(node: str) -> type[ParameterGroup]:
    """Return the parameters of a node by its name."""
    return TREES[node]


def parameter_file(tree: type[ParameterGroup]) -> str:
    """Return all defaults as a ROS parameter file, each line with its meaning."""
    values = {spec.name: spec.default for spec in tree.specs()}
    lines = dump_ros_yaml(values).splitlines()
    # The dump keeps the order of the specs, so that its leaves and the specs go in step.
    remaining = iter(tree.specs())
    return '\n'.join(
        line if line.endswith(':') else f'{line}  # {_meaning(next(remaining))}' for line in lines
    ) + '\n'


def markdown_table(tree: type[ParameterGroup]) -> str:
    """Return the table name, default, unit, allowed, meaning."""
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
