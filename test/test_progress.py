# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Progress lines of the verbs: none in the log of a short run, a few in that of a long one."""

from __future__ import annotations

from pathlib import Path
import re

import gip_localizer.cli
from gip_localizer.cli import progress as module
from gip_localizer.cli.progress import progress


def test_the_log_of_a_short_run_has_no_progress(capsys):
    with progress(3, 'working') as bar:
        for _ in range(3):
            bar.update()
    assert capsys.readouterr().err == ''


def test_the_log_of_a_long_run_has_some(capsys, monkeypatch):
    monkeypatch.setattr(module, 'LOGGED', 0.0)
    with progress(None, 'working', iterable=range(3)) as bar:
        assert list(bar) == [0, 1, 2]
    assert 'working' in capsys.readouterr().err


def test_every_verb_uses_it():
    for path in Path(gip_localizer.cli.__file__).parent.glob('*.py'):
        if path.name != 'progress.py':
            assert not re.search(r'import tqdm', path.read_text()), path
