# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Imports point one way: a folder imports only from itself and from folders before it."""

import ast
from pathlib import Path
import sys

PACKAGE = Path(__file__).parents[1] / 'gip_localizer'
FOLDERS = (
    'errors', 'parameters', 'core', 'io', 'session', 'visualization', 'api', 'synthetic',
    'mapping', 'paper', 'evaluation', 'benchmark', 'ros', 'cli',
)
"""Of the package, each after all that it imports."""
ROOMS = (
    'arrays', 'threads', 'pose', 'belief', 'kernels', 'cell_means', 'gramian', 'camera',
    'birdseye', 'map', 'match', 'refine', 'calibrated_view', 'estimate', 'search',
    'confidence', 'confidence_terms', 'match_figures', 'integrity', 'protection_terms',
    'protection', 'track', 'guard', 'judged_search', 'track_verdicts', 'stage_times',
    'localizer',
)
"""Of `core`, in the same manner."""
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


def backward(folder: Path, order: tuple[str, ...], depth: int) -> list[str]:
    """Imports from a folder that comes later in the order, as `file imports module`."""
    found = []
    for path in sorted(folder.rglob('*.py')):
        own = path.relative_to(folder).with_suffix('').parts[0]
        if own == '__init__':
            continue
        for name in sorted(imported(path)):
            parts = name.split('.')
            if parts[: depth + 1] != ['gip_localizer', 'core'][: depth + 1]:
                continue
            other = parts[depth + 1]
            if other != '__version__' and order.index(other) > order.index(own):
                found.append(f'{path.relative_to(PACKAGE)} imports {name}')
    return found


def test_imports_point_one_way():
    assert backward(PACKAGE, FOLDERS, 0) + backward(PACKAGE / 'core', ROOMS, 1) == []


def test_core_needs_numpy_scipy_and_opencv_and_only_ros_needs_ros():
    for path in PACKAGE.rglob('*.py'):
        outside = {name.split('.')[0] for name in imported(path)}
        folder = path.relative_to(PACKAGE).parts[0]
        if folder == 'core':
            assert outside - set(sys.stdlib_module_names) <= CORE_PACKAGES, path
        if folder != 'ros':
            assert not outside & ROS_PACKAGES, path
