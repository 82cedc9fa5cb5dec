# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A short synthetic drive, recorded once per test session, and bags made of its messages."""

from __future__ import annotations

from collections.abc import Callable
import fcntl
import json
import os
from pathlib import Path

from bag_samples import write_mcap
import pytest

from gip_localizer.cli import main
from gip_localizer.io.bags.bag import Bag

SMALL = ['--set', 'lens.width=640', '--set', 'lens.height=360', '--set', 'lens.focal=450']
ROUGH = ['--set', 'world.resolution=0.05', '--set', 'world.join=1']  # a world quick to make
COARSE = ['--set', 'birdseye.resolution=0.1']
Recorded = list[tuple[str, str, int, bytes]]


def made_once(tmp_path_factory, name: str, make: Callable[[Path], None]) -> Path:
    """A folder of the test session; the first of the parallel workers to need it makes it."""
    shared = tmp_path_factory.getbasetemp()
    if 'PYTEST_XDIST_WORKER' in os.environ:
        shared = shared.parent
    out = shared / name
    with (shared / f'{name}.lock').open('a') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not out.exists():
            make(out)
    return out


@pytest.fixture(scope='session')
def drive(tmp_path_factory) -> Path:
    """A folder of `gip simulate`: 2.5 s at 10 Hz, raw images."""
    def simulate(out: Path) -> None:
        assert main(['simulate', '--seconds', '2.5', '--out', str(out), *SMALL]) == 0

    return made_once(tmp_path_factory, 'drive', simulate)


@pytest.fixture(scope='session')
def whole(drive, tmp_path_factory) -> tuple[Path, dict]:
    """The results folder of the whole drive as it was recorded, and its metrics."""
    out = made_once(tmp_path_factory, 'whole', lambda out: replayed(
        drive, drive, out, report=True
    ))  # fmt: skip
    return out, json.loads((out / 'metrics.json').read_text())


def recorded(folder: Path) -> Recorded:
    """Every message of a bag, serialized."""
    bag = Bag([folder])
    return [(m.topic, m.msgtype, m.log_ns, bytes(m.raw))
            for m in bag.messages([topic.name for topic in bag.topics])]


def options_of(drive: Path) -> list[str]:
    """The options that name the drive's map and parameters."""
    return ['--map', str(drive / 'map.yaml'), '--params', str(drive / 'params.yaml')]


def replayed(bag: Path, drive: Path, out: Path, *options: str, expected: int = 0,
             report: bool = False) -> dict:
    """Replay through the command line; return `metrics.json`."""
    options = (*options, *([] if report else ['--no-report']))
    code = main(['replay', str(bag), *options_of(drive), *COARSE, '--out', str(out), *options])
    assert code == expected
    return json.loads((out / 'metrics.json').read_text())


def rewritten(path: Path, messages: Recorded, **how) -> Path:
    return write_mcap(path, messages, chunk_size=1 << 20, **how)
