# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of the benchmark that need a process of their own."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import json
import os
import subprocess
import sys
from typing import Any

from gip_localizer.errors import GipError

PATIENCE = 3600.0


def child(module: str, arguments: Sequence[str], environment: Mapping[str, str]) -> dict[str, Any]:
    """
    Run a module of this package and return the JSON object that it prints.

    Raises
    ------
    GipError
        It failed; the message holds its last words.

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
