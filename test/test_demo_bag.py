# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The bag that comes with the sources."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from gip_localizer.cli import main
from gip_localizer.io.bags.bag import Bag

BAGS = Path(__file__).parents[1] / 'bags'


def test_it_is_small_and_opens_without_complaint():
    assert sum(path.stat().st_size for path in (BAGS / 'demo').iterdir()) <= 3_000_000
    bag = Bag([BAGS / 'demo'])
    assert bag.notes == []
    text = (BAGS / 'README.md').read_text(encoding='utf-8')
    for topic in bag.topics:
        assert topic.name in text


@pytest.fixture(scope='module')
def results(tmp_path_factory):
    folders = [tmp_path_factory.mktemp('demo') / name for name in ('first', 'second')]
    for out in folders:
        assert main(['replay', str(BAGS / 'demo'), '--out', str(out)]) == 0
    return folders


def test_it_is_localized(results):
    metrics = json.loads((results[0] / 'metrics.json').read_text())
    assert metrics['frames'] == 40
    assert metrics['availability'] >= 0.95
    assert metrics['rmse_xy_m'] <= 0.01
    assert metrics['rmse_yaw_deg'] <= 0.1
    assert metrics['wrong_published'] == 0


def test_a_second_replay_gives_the_same_bytes(results):
    first, second = results
    for name in ('estimate.tum', 'ground_truth.tum', 'published.mcap', 'params.yaml'):
        assert (first / name).read_bytes() == (second / name).read_bytes(), name
    figures = [json.loads((out / 'metrics.json').read_text()) for out in results]
    for metrics in figures:
        del metrics['latency_ms'], metrics['frames_per_second']
    assert figures[0] == figures[1]
