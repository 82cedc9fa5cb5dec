# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The middleware's settings for large images, wherever the package is installed."""

from __future__ import annotations

import os
from pathlib import Path
import sys

PROFILES = ('FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE')
"""Fast DDS 2 (Jazzy) reads the first, Fast DDS 3 (Kilted) the second."""
RELATIVE = Path('share/gip_localizer/config/fastdds.xml')


def profile_path() -> Path | None:
    """
    Find the Fast DDS profile: in the source tree, a prefix of ament, or that of Python.

    Returns
    -------
    Path or None
        None where the package was installed without its data files.

    """
    prefixes = [Path(p) for p in os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep) if p]
    module = Path(__file__).resolve()
    # pip and colcon put modules at PREFIX/lib/pythonX.Y/site-packages.
    prefixes += [*module.parents, Path(sys.prefix)]
    candidates = [module.parents[2] / 'config' / 'fastdds.xml']
    candidates += [prefix / RELATIVE for prefix in prefixes]
    return next((path for path in candidates if path.is_file()), None)


def image_environment() -> dict[str, str]:
    """Return the variables that let large images through, unless the user has set their own."""
    path = profile_path()
    if path is None or any(name in os.environ for name in PROFILES):
        return {}
    return dict.fromkeys(PROFILES, str(path))


def private_graph(domain: int) -> dict[str, str]:
    """Return the variables of a graph that only this machine and this domain see."""
    return {'ROS_DOMAIN_ID': str(domain), 'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST'}
