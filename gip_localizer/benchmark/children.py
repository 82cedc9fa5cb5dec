# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Run parts of the benchmark in separate processes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
import os
import subprocess
import sys
from typing import Any

from gip_localizer.errors import GipError

PATIENCE = 3600.0
"""Longest duration of a child process, seconds; chosen."""


def child(module: str, arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, Any]:
    """
    Run a module of this package and return the JSON object that it prints.

    Raises
    ------
    GipError
        The module failed; the message holds its last output.

    """
    done = subprocess.run(
        [sys.executable, '-m', module, *arguments], capture_output=True, check=False,
        env={**os.environ, **environment}, timeout=PATIENCE,
    )
    if done.returncode != 0:
        words = done.stderr.decode(errors='replace').strip().splitlines()[-5:]
        raise GipError(f'{module} {" ".join(arguments)} failed: ' + ' | '.join(words))
    found: dict[str, Any] = json.loads(done.stdout)
    return found
