# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The package as others install it: by pip and by colcon, away from the source tree."""

import os
from pathlib import Path
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

ROOT = Path(__file__).parents[1]
EXECUTABLES = ('localizer', 'synthetic_camera', 'bag_player', 'gip')
NOT_SOURCES = (
    '.*', 'build', 'dist', 'install', 'log', 'results', '*.egg-info', '*.so', '__pycache__',
)


def run(command, **options):
    return subprocess.run(
        [str(part) for part in command],
        capture_output=True, text=True, timeout=300, check=False, **options,
    )  # fmt: skip


def inherited(**changes):
    return {**os.environ, **{key: str(value) for key, value in changes.items()}}


@pytest.fixture(scope='module')
def sources(tmp_path_factory):
    """A copy, so that no build folder appears in the working tree."""
    copy = tmp_path_factory.mktemp('workspace') / 'src' / 'gip_localizer'
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(*NOT_SOURCES))
    return copy


@pytest.fixture(scope='module')
def quick_compiler(tmp_path_factory):
    """The environment of a GCC that does not optimize: what is built is shown, not its speed."""
    path = tmp_path_factory.mktemp('compiler') / 'quick-gcc'
    path.write_text('#!/bin/sh\nexec gcc "$@" -O0\n')
    path.chmod(0o755)
    return inherited(CC=path)


@pytest.fixture(scope='module')
def pip_prefix(sources, quick_compiler, tmp_path_factory):
    prefix = tmp_path_factory.mktemp('pip') / 'prefix'
    made = run([
        sys.executable, '-m', 'pip', 'install', '--quiet', '--no-deps', '--no-build-isolation',
        '--no-index', '--ignore-installed', '--prefix', prefix, sources,
    ], env=quick_compiler)  # fmt: skip
    assert made.returncode == 0, made.stderr
    return prefix


@pytest.fixture(scope='module')
def colcon_prefix(sources, quick_compiler):
    workspace = sources.parents[1]
    made = run([sys.executable, '-m', 'colcon', 'build'], cwd=workspace, env=quick_compiler)
    assert made.returncode == 0, made.stdout + made.stderr
    return workspace / 'install' / 'gip_localizer'


def site_packages(prefix):
    """Where the package's modules went below a prefix, whatever scheme the installer chose."""
    [init] = prefix.rglob('gip_localizer/errors.py')
    return init.parents[1]


def refuses_a_missing_map(command, prefix, tmp_path):
    """Start the installed node for real: it must name the parameter and end with 1."""
    result = run(
        [command, '--ros-args', '-p', f'map_file:={tmp_path}/none.yaml'],
        cwd=tmp_path, env=inherited(PYTHONPATH=site_packages(prefix)),
    )  # fmt: skip
    assert result.returncode == 1, result.stderr
    assert 'none.yaml' in result.stderr
    assert 'Traceback' not in result.stderr


@pytest.mark.parametrize('name', EXECUTABLES)
def test_pip_puts_each_executable_on_the_path_and_where_ros2_looks(pip_prefix, name):
    for path in (pip_prefix / 'bin' / name, pip_prefix / 'lib' / 'gip_localizer' / name):
        assert os.access(path, os.X_OK), path


def test_pip_installs_what_ament_looks_up(pip_prefix):
    share = pip_prefix / 'share'
    assert (share / 'ament_index/resource_index/packages/gip_localizer').is_file()
    assert (share / 'gip_localizer/package.xml').is_file()
    assert (share / 'gip_localizer/config/fastdds.xml').is_file()
    assert (share / 'gip_localizer/launch/localizer.launch.py').is_file()


def test_pip_installs_every_module(pip_prefix):
    modules = {path.relative_to(ROOT) for path in (ROOT / 'gip_localizer').rglob('*.py')}
    installed = site_packages(pip_prefix)
    assert {module for module in modules if not (installed / module).is_file()} == set()


@pytest.mark.skipif(not shutil.which('gcc'), reason='no GCC here')
def test_pip_and_colcon_build_the_loops(pip_prefix, colcon_prefix):
    for prefix in (pip_prefix, colcon_prefix):
        folder = site_packages(prefix) / 'gip_localizer/core/kernels'
        assert list(folder.glob('_kernels.*.so')), prefix


def test_without_a_compiler_the_package_installs_all_the_same(tmp_path):
    sources = tmp_path / 'sources'  # without what other tests built
    shutil.copytree(ROOT, sources, ignore=shutil.ignore_patterns(*NOT_SOURCES))
    result = run(
        [sys.executable, '-m', 'pip', 'install', '--no-deps', '--no-build-isolation', '--no-index',
         '--target', tmp_path / 'target', sources],
        cwd=tmp_path, env=inherited(CC='no-such-compiler'),
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert (tmp_path / 'target/gip_localizer/core/kernels/library.py').is_file()
    assert not list((tmp_path / 'target/gip_localizer/core/kernels').glob('_kernels.*'))


@pytest.mark.parametrize('folder', ['bin', 'lib/gip_localizer'])
def test_pip_installed_localizer_starts(pip_prefix, folder, tmp_path):
    refuses_a_missing_map(pip_prefix / folder / 'localizer', pip_prefix, tmp_path)


@pytest.mark.parametrize('folder', ['bin', 'lib/gip_localizer'])
def test_pip_installed_desk_tool_runs_the_installed_code(pip_prefix, folder, tmp_path):
    result = run(
        [pip_prefix / folder / 'gip', '--help'],
        cwd=tmp_path, env=inherited(PYTHONPATH=site_packages(pip_prefix)),
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert 'demo' in result.stdout


@pytest.mark.parametrize('name', EXECUTABLES)
def test_colcon_puts_each_executable_where_ros2_looks(colcon_prefix, name):
    assert os.access(colcon_prefix / 'lib' / 'gip_localizer' / name, os.X_OK)


def test_colcon_built_localizer_starts(colcon_prefix, tmp_path):
    refuses_a_missing_map(colcon_prefix / 'lib/gip_localizer/localizer', colcon_prefix, tmp_path)


def test_wrappers_work_without_a_bin_folder_beside_them(sources, tmp_path):
    """A machine whose lib/gip_localizer holds nothing but the wrapper: python3 runs the module."""
    search = f'{Path(sys.executable).parent}{os.pathsep}{os.environ["PATH"]}'
    result = run(
        [sources / 'resource/executables/gip', '--help'],
        cwd=tmp_path, env=inherited(PYTHONPATH=sources, PATH=search),
    )  # fmt: skip
    assert result.returncode == 0, result.stderr
    assert 'demo' in result.stdout


def test_both_metadata_files_tell_the_same_version():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    printed = run([sys.executable, 'setup.py', '--version'], cwd=ROOT)
    assert printed.stdout.split()[-1] == manifest.findtext('version')


def test_no_ros_wheel_is_required_outside_the_extra(sources):
    printed = run([
        sys.executable, '-c',
        'from setuptools.build_meta import prepare_metadata_for_build_wheel as go; print(go("."))',
    ], cwd=sources)  # fmt: skip
    metadata = sources / printed.stdout.split()[-1] / 'METADATA'
    lines = metadata.read_text().splitlines()
    required = [line for line in lines if line.startswith('Requires-Dist')]
    assert [line for line in required if 'ros-jazzy' in line and 'extra ==' not in line] == []
    assert len([line for line in required if 'ros-jazzy' in line]) == 3
