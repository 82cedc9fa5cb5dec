# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Description of the machine and the software versions of a benchmark."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version
import os
from pathlib import Path
import platform
from typing import Any

import cv2
import numpy as np
import scipy

from gip_localizer.core.kernels.binding import AVAILABLE
from gip_localizer.core.threads import WORKERS


def machine() -> dict[str, Any]:
    """Return processor, software versions and settings."""
    return {
        'processor': _processor(), 'cores': os.cpu_count(), 'workers': WORKERS,
        'load_before': list(os.getloadavg()), 'system': platform.platform(),
        'python': platform.python_version(), 'numpy': np.__version__, 'scipy': scipy.__version__,
        'opencv': cv2.__version__, 'opencv_ipp': bool(getattr(cv2, 'ipp', None))
        and bool(cv2.ipp.useIPP()), 'opencv_threads': cv2.getNumThreads(),
        'compiled_kernels': AVAILABLE,
        'openblas_threads': os.environ.get('OPENBLAS_NUM_THREADS', 'all'),
        'gip_localizer': _own_version(),
    }


def _processor() -> str:
    info = Path('/proc/cpuinfo')
    if info.is_file():
        for line in info.read_text().splitlines():
            if line.startswith('model name'):
                return line.split(':', 1)[1].strip()
    return platform.processor() or 'unknown'


def _own_version() -> str:
    try:
        return version('gip_localizer')
    except PackageNotFoundError:
        return 'source tree'
