# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that hold images and their masks."""

from __future__ import annotations

from drive_samples import recorded, replayed, rewritten
import numpy as np
import pytest

from gip_localizer.cli import main
from gip_localizer.io.cdr import jazzy

IMAGE = '/image'


@pytest.fixture(scope='module')
def messages(drive):
    return recorded(drive)


def masks(messages, every=1, stamp_ns=0):
    """A mask after every n-th image, 40 ms later in the log, that leaves all to be looked at."""
    out = []
    for n, (_, _, log, raw) in enumerate(m for m in messages if m[0] == IMAGE):
        if n % every == 0:
            mask = jazzy().deserialize_cdr(raw, 'sensor_msgs/msg/Image')
            mask.header.stamp.nanosec += stamp_ns
            mask.data = np.full_like(mask.data, 255)
            late = bytes(jazzy().serialize_cdr(mask, 'sensor_msgs/msg/Image'))
            out.append(('/network/mask', 'sensor_msgs/msg/Image', log + 40_000_000, late))
    return sorted([*messages, *out], key=lambda m: m[2])


def test_masks_of_the_bag_are_paired_and_change_nothing_where_they_hide_nothing(
    drive, whole, messages, tmp_path
):
    without, metrics_without = whole
    bag = rewritten(tmp_path / 'a.mcap', masks(messages))
    metrics = replayed(bag, drive, tmp_path / 'out', '--mask-topic', '/network/mask',
                       '--set', 'mask.required=true')
    assert metrics['published'] == metrics_without['published']
    read = [(folder / 'estimate.tum').read_text() for folder in (tmp_path / 'out', without)]
    assert read[0] == read[1]
    by_name = replayed(bag, drive, tmp_path / 'again', '--set', 'mask.from_topic=true',
                       '--duration', '0.5')
    assert by_name['frames'] == 5


def test_missing_masks_are_counted(drive, messages, tmp_path, capsys):
    bag = rewritten(tmp_path / 'a.mcap', masks(messages, every=5, stamp_ns=1))
    metrics = replayed(bag, drive, tmp_path / 'out', '--mask-topic', 'network/mask',
                       '--duration', '1.0')
    assert metrics['frames'] == metrics['published'] == 10
    assert 'MASK_MISSING in 10 of 10 frames' in capsys.readouterr().err


def test_a_mask_topic_that_is_not_there_is_told(drive, capsys, tmp_path):
    for options in (['--mask-topic', '/nowhere'], ['--set', 'mask.from_topic=true']):
        assert main(['replay', str(drive), '--out', str(tmp_path / 'out'), *options]) == 1
        assert '--mask-topic' in capsys.readouterr().err
