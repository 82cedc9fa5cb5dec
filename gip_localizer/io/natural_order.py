# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Order of numbered files."""

from __future__ import annotations

from pathlib import Path
import re


def natural_key(path: Path) -> list[tuple[int, str]]:
    """Order bag_2 before bag_10, by the name of the file."""
    parts = re.split(r'(\d+)', path.name)
    return [(int(part), '') if part.isdigit() else (-1, part) for part in parts]
