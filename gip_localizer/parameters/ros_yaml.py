# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS parameter files: dotted names nested under `ros__parameters`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from gip_localizer.errors import ParameterError
from gip_localizer.parameters.spec import Value
from gip_localizer.parameters.yaml_files import read_yaml, user_path, YamlFileError

OF_ANY_NODE = ('use_sim_time', 'start_type_description_service', 'qos_overrides.')
"""What `ros2 param dump` writes in addition to the parameters of the tree."""


def dump_ros_yaml(values: Mapping[str, Value], node: str = '/**') -> str:
    """Return a ROS parameter file (nested under `ros__parameters`) as text."""
    tree: dict[str, Any] = {}
    for name, value in values.items():
        *groups, leaf = name.split('.')
        branch = tree
        for part in groups:
            branch = branch.setdefault(part, {})
        branch[leaf] = value
    text: str = yaml.safe_dump({node: {'ros__parameters': tree}}, sort_keys=False)
    return text


def load_ros_yaml(path: Path | str) -> dict[str, Value]:
    """
    Read a ROS parameter file into dotted names, but for those that every node has.

    Raises
    ------
    ParameterError
        Unreadable, not YAML, or without `ros__parameters`.

    """
    expected = 'expected a ROS parameter YAML, as gip params --yaml writes it'
    try:
        content = read_yaml(user_path(path))
    except FileNotFoundError:
        raise ParameterError(f'parameter file {path}: does not exist; {expected}') from None
    except YamlFileError as error:
        raise ParameterError(f'parameter file {path}: {error}; {expected}') from None
    sections = content.values() if isinstance(content, dict) else []
    found = [s['ros__parameters'] for s in sections
             if isinstance(s, dict) and isinstance(s.get('ros__parameters'), dict)]
    if not found:
        raise ParameterError(
            f'parameter file {path}: no "ros__parameters" section; '
            'write one with: gip params --yaml'
        )
    values: dict[str, Value] = {}
    for section in found:
        values.update(_flatten(section, ''))
    return {name: value for name, value in values.items() if not name.startswith(OF_ANY_NODE)}


def _flatten(tree: Mapping[str, Any], prefix: str) -> dict[str, Value]:
    flat: dict[str, Value] = {}
    for key, value in tree.items():
        if isinstance(value, dict):
            flat.update(_flatten(value, f'{prefix}{key}.'))
        else:
            flat[f'{prefix}{key}'] = value
    return flat
