# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Imports point one way: cli, ros -> evaluation, synthetic, io -> core -> parameters, errors."""

import ast
from pathlib import Path
import sys

import pytest

PACKAGE = Path(__file__).parents[1] / 'gip_localizer'
LOWEST = {'parameters', 'parameter_specs', 'stack_parameters', 'errors'}
MIDDLE = {'evaluation', 'synthetic', 'io'}
MAY_IMPORT = {
    'errors': {'errors'},
    'parameters': LOWEST,
    'parameter_specs': LOWEST,
    'stack_parameters': LOWEST,
    'core': {'core'} | LOWEST,
    **{layer: MIDDLE | {'core'} | LOWEST for layer in MIDDLE},
    **{top: {'cli', 'ros', 'core'} | MIDDLE | LOWEST for top in ('cli', 'ros')},
}
ROS_PACKAGES = {
    'rclpy', 'ament_index_python', 'rcl_interfaces', 'tf2_ros', 'tf2_msgs', 'lifecycle_msgs',
}
CORE_PACKAGES = {'numpy', 'scipy', 'cv2', 'gip_localizer'}


def imported(path: Path) -> set[str]:
    """All modules that a file names in an import, wherever in the file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f'{path}: relative import'
            found |= {f'{node.module}.{alias.name}' for alias in node.names}
    return found


MODULES = sorted(set(PACKAGE.rglob('*.py')) - {PACKAGE / '__init__.py'})
CORE = sorted((PACKAGE / 'core').glob('*.py'))


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_follow_the_arrows(path):
    layer = path.relative_to(PACKAGE).with_suffix('').parts[0]
    names = [name.split('.') for name in imported(path)]
    own = {name[1] for name in names if name[0] == 'gip_localizer' and len(name) > 1}
    assert own <= MAY_IMPORT[layer] | {'__version__'}
    if layer != 'ros':
        assert not {name[0] for name in names} & ROS_PACKAGES


@pytest.mark.parametrize('path', CORE, ids=lambda path: path.stem)
def test_core_needs_only_numpy_scipy_and_opencv(path):
    outside = {name.split('.')[0] for name in imported(path)} - set(sys.stdlib_module_names)
    assert outside <= CORE_PACKAGES
