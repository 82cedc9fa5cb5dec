# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Python, its packages, the compiled loops, ROS and the shared memory of this machine.

Nothing that may be missing is imported at the top, so that what is missing is reported.

"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
import importlib
import os
from pathlib import Path
import re
import subprocess
import sys
import tempfile

from gip_localizer.errors import shortened
from gip_localizer.ros.doctor.check import Check
from gip_localizer.ros.middleware import profile_path, PROFILES

PYTHONS = ((3, 10), (3, 14))
"""Least and newest version of CPython for which ROS wheels exist."""
LIBRARIES = {'numpy': ('NumPy', (1, 26)), 'cv2': ('OpenCV', (4, 6)), 'scipy': ('SciPy', (1, 0))}
"""Module → name and least version, as in setup.py."""
PACKAGES = {
    'simplejpeg': 'simplejpeg', 'mcap': 'mcap', 'rosbags': 'rosbags', 'zstandard': 'zstandard',
    'apsw': 'apsw', 'yaml': 'PyYAML', 'matplotlib': 'matplotlib', 'tqdm': 'tqdm',
    'jinja2': 'jinja2',
}
"""Module → name for pip, as in setup.py."""
IMPORTS = """
import builtin_interfaces.msg, diagnostic_msgs.msg, geometry_msgs.msg, nav_msgs.srv
import rosgraph_msgs.msg, sensor_msgs.msg, std_msgs.msg, std_srvs.srv
print(std_srvs.srv.__file__, flush=True)
import rclpy
print(rclpy.get_rmw_implementation_identifier())
"""
"""What the nodes import of ROS; tf2_msgs and nav2_msgs are optional."""
IMPORT_TIME = 60.0
"""Longest time (s) for these imports, which take 0.5 s on an idle machine; chosen."""
MOST_DOMAIN = 232
"""Largest ROS_DOMAIN_ID: the ports of a larger one do not exist."""
SHARED_MEMORY = Path('/dev/shm')
"""Where Linux keeps the memory that processes share."""
SEGMENTS = 3
"""Processes whose image segments must fit at the same time: camera, node and a viewer; chosen."""
MIB = 1 << 20
"""Bytes of a mebibyte."""
BROKEN = (ImportError, OSError, RuntimeError, AttributeError, ValueError)
"""What the import of a package raises that is damaged or built for another machine."""


def environment_checks() -> list[Callable[[], Check]]:
    """Return the checks in the order in which they are made."""
    return [python, libraries, packages, kernels, rclpy_and_messages, middleware, shared_memory]


def python() -> Check:
    """Check the version of Python."""
    found = f'{sys.version.split()[0]} ({_dotted(PYTHONS[0])} to {_dotted(PYTHONS[1])})'
    if PYTHONS[0] <= sys.version_info[:2] <= PYTHONS[1]:
        return Check('python', found)
    return Check('python', found, 'make a new environment with one of these versions: '
                 'python3.12 -m venv .venv')


def libraries() -> Check:
    """Check the versions of the libraries that compute."""
    found, faults = [], []
    for module, (name, least) in LIBRARIES.items():
        version, fault = _version(module)
        found.append(f'{name} {version or fault} (from {_dotted(least)})')
        if fault or _numbers(version) < least:
            faults.append(name)
    remedy = 'pip install --upgrade numpy scipy opencv-python-headless' if faults else ''
    return Check('libraries', ', '.join(found), remedy)


def packages() -> Check:
    """Check that every other package can be imported."""
    faults = {pip: fault for module, pip in PACKAGES.items() if (fault := _version(module)[1])}
    if not faults:
        return Check('packages', f'all {len(PACKAGES)} can be imported')
    return Check('packages', '; '.join(f'{pip}: {fault}' for pip, fault in faults.items()),
                 f'pip install --force-reinstall {" ".join(faults)}')


def kernels() -> Check:
    """Check that the compiled loops are there; without them a frame takes several times longer."""
    if os.environ.get('GIP_COMPILED') == '0':
        return Check('kernels', 'compiled loops are switched off by GIP_COMPILED=0')
    try:
        from gip_localizer.core.kernels.binding import AVAILABLE
    except BROKEN as error:
        return Check('kernels', f'cannot be loaded: {error}', 'see the check of the libraries')
    if AVAILABLE:
        return Check('kernels', 'compiled loops are loaded')
    return Check('kernels', 'no compiled loops: a frame takes several times longer',
                 'install a C compiler (apt install gcc python3-dev) and this package again: '
                 'pip install --force-reinstall --no-deps .')


def rclpy_and_messages() -> Check:
    """Check that rclpy and the message packages can be imported, and where rclpy is from."""
    answer = _imported()
    if answer.returncode != 0 and not _of_the_middleware(answer):
        return Check('ROS', _last_line(answer), (
            "without an installed ROS: pip install 'gip_localizer[ros]'; with one: "
            'source /opt/ros/jazzy/setup.bash'
        ))  # fmt: skip
    path = answer.stdout.split('\n')[0]
    return Check('ROS', f'of {"the wheels" if sys.prefix in path else path}')


def middleware() -> Check:
    """Check which middleware is used, and its profile for large images."""
    name, answer = 'middleware', _imported()
    if answer.returncode != 0 and not _of_the_middleware(answer):
        return Check(name, 'not checked', 'follow the remedy of ROS first')
    if answer.returncode != 0:
        asked = os.environ.get('RMW_IMPLEMENTATION') or 'unset'
        return Check(name, _last_line(answer), (
            f'pip install ros-jazzy-rmw-fastrtps-cpp; RMW_IMPLEMENTATION is {asked}: unset it, or '
            'install what it names'
        ))  # fmt: skip
    used, domain = answer.stdout.split('\n')[1], os.environ.get('ROS_DOMAIN_ID') or '0'
    if not (domain.isdecimal() and int(domain) <= MOST_DOMAIN):
        return Check(name, f'{used}, ROS_DOMAIN_ID is {domain!r}',
                     f'set it to a number from 0 to {MOST_DOMAIN}: export ROS_DOMAIN_ID=0')
    found = f'{used}, domain {domain}'
    if 'fastrtps' not in used:
        return Check(name, f'{found}; large images need its own settings')
    return _profile(name, found)


@cache
def _imported() -> subprocess.CompletedProcess[str]:
    """Import ROS in a process of its own: a wrong middleware ends the process that loads it."""
    return subprocess.run(
        [sys.executable, '-c', IMPORTS], capture_output=True, text=True, check=False,
        timeout=IMPORT_TIME,
    )  # fmt: skip


def _of_the_middleware(answer: subprocess.CompletedProcess[str]) -> bool:
    """Whether the middleware ended the process, and not a package that is missing."""
    return 'rmw' in answer.stderr.lower()


def _last_line(answer: subprocess.CompletedProcess[str]) -> str:
    lines = answer.stderr.strip().splitlines()
    return shortened(lines[-1]) if lines else f'Python ended with {answer.returncode}'


def _profile(name: str, found: str) -> Check:
    """Check the profile of Fast DDS."""
    own = {variable: os.environ[variable] for variable in PROFILES if variable in os.environ}
    for variable, path in own.items():
        if not Path(path).is_file():
            return Check(name, f'{found}, {variable} is {path!r}: no such file',
                         f'unset {variable}, or name a file; {profile_path()} is for large images')
    used = next(iter(own.values()), profile_path())
    if used is None:
        return Check(name, f'{found}, no profile for large images: the package was installed '
                     'without its data files', 'pip install (not --editable), or set '
                     f'{PROFILES[0]} to config/fastdds.xml of the sources')
    return Check(name, f'{found}, profile {used}')


def shared_memory(folder: Path = SHARED_MEMORY) -> Check:
    """Check that segments for images fit into the shared memory, and that it can be written."""
    name = 'shared memory'
    if not folder.is_dir():
        return Check(name, f'{folder} does not exist', 'mount it: mount -t tmpfs tmpfs /dev/shm')
    size, least = os.statvfs(folder), SEGMENTS * _segment_bytes()
    free = size.f_bavail * size.f_frsize
    found = f'{folder} has {free // MIB} MiB free ({least // MIB} MiB wanted)'
    if free < least:
        left = [path.name for path in folder.glob('fastrtps_*')]
        return Check(name, f'{found}, {len(left)} files of Fast DDS', (
            'in a container start it with --shm-size=512m (or --ipc=host); otherwise stop all '
            f'ROS nodes and remove {folder}/fastrtps_* and {folder}/sem.fastrtps_*'
        ))  # fmt: skip
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            os.posix_fallocate(file.fileno(), 0, MIB)
    except OSError as error:
        return Check(name, f'{folder} cannot be written: {error.strerror}',
                     f'chmod 1777 {folder}, or mount it without ro')
    return Check(name, found)


def _segment_bytes() -> int:
    """Return the size of a process's segment, as the profile of Fast DDS sets it."""
    path = profile_path()
    text = '' if path is None else path.read_text(encoding='utf-8')
    found = re.search(r'<segment_size>(\d+)<', text)
    return int(found.group(1)) if found else 32 * MIB


def _version(module: str) -> tuple[str, str]:
    """Return the version of a module, or why it cannot be imported."""
    try:
        loaded = importlib.import_module(module)
    except BROKEN as error:
        return '', f'cannot be imported ({str(error).splitlines()[0] if str(error) else error!r})'
    return str(getattr(loaded, '__version__', '')), ''


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(number) for number in re.findall(r'\d+', version)[:2])


def _dotted(version: tuple[int, int]) -> str:
    return f'{version[0]}.{version[1]}'
