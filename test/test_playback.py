# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The position in a bag that is played, and the quality of service that was recorded."""

from __future__ import annotations

from bag_samples import EPOCH, ODOM, serialized, small_drive, write_mcap
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer

from gip_localizer.errors import BagError
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.bags.offered_qos import offered_qos, OfferedQos
from gip_localizer.io.bags.playback import Playback
from gip_localizer.io.bags.writer import BagWriter
from gip_localizer.io.cdr import jazzy

S = 1_000_000_000
STREAM = [one for one in serialized(small_drive()) if one[1] == ODOM]
TIMES = [log for _, _, log, _ in STREAM]


def played(path, start_ns=None):
    bag = Bag([path])
    return Playback(bag, ['/odom'], bag.start_ns if start_ns is None else start_ns)


def test_what_is_due_comes_once_and_in_order(tmp_path):
    playback = played(write_mcap(tmp_path / 'a.mcap', STREAM))
    heard = [one.log_ns for _ in range(500) for one in playback.advance(S // 100)]
    assert heard == TIMES
    assert playback.ended


def test_step_and_seek_move_the_position(tmp_path):
    playback = played(write_mcap(tmp_path / 'a.mcap', STREAM))
    assert [playback.step().log_ns for _ in range(3)] == TIMES[:3]
    assert playback.seek(TIMES[10] - 1)
    assert playback.now_ns == TIMES[10]
    assert playback.step().log_ns == TIMES[10]
    assert playback.seek(TIMES[0])
    assert [one.log_ns for one in playback.advance(TIMES[4] - TIMES[0])] == TIMES[:5]
    for beyond in (TIMES[0] - 1, TIMES[-1] + 1):
        assert not playback.seek(beyond)
    assert playback.step().log_ns == TIMES[5]
    assert [one.log_ns for one in playback.before(['/odom'])] == TIMES[:5]


@pytest.mark.parametrize('stray', [0, 2**64 - 2])
def test_messages_of_another_clock_are_not_played(tmp_path, stray):
    path = write_mcap(tmp_path / 'a.mcap', [(*STREAM[0][:2], stray, STREAM[0][3]), *STREAM])
    playback = played(path)
    assert playback.now_ns == TIMES[0]
    assert [one.log_ns for one in playback.advance(1000 * S)] == TIMES
    assert playback.ended


def test_a_start_beyond_the_end_and_times_that_are_none_are_refused(tmp_path):
    path = write_mcap(tmp_path / 'a.mcap', STREAM)
    with pytest.raises(BagError, match='parameter start: the bag ends'):
        played(path, TIMES[-1] + 1)
    far = [(topic, kind, log + 2**62, raw) for topic, kind, log, raw in STREAM]
    with pytest.raises(BagError, match='a clock that is set'):
        played(write_mcap(tmp_path / 'b.mcap', far))


BEST_EFFORT = '- reliability: best_effort\n  durability: volatile\n  depth: 5\n'
NUMBERS = '- reliability: 1\n  durability: 1\n  depth: 0\n- reliability: 2\n  durability: 2\n'


@pytest.mark.parametrize(('text', 'expected'), [
    (BEST_EFFORT, (OfferedQos(False, False, 5),)),
    (NUMBERS, (OfferedQos(True, True, 0), OfferedQos(False, False, 0))),
    ('', ()), ('{', ()), ('7', ()), ('- 7', ()), ('[' * 100_000, ()),
])
def test_profiles_are_read_as_words_and_numbers_and_bad_ones_are_none(text, expected):
    assert offered_qos(text) == expected


def test_every_storage_knows_what_was_offered(tmp_path):
    kind = STREAM[0][1]
    with BagWriter(tmp_path / 'mcap', {'/odom': kind}, latched=frozenset(['/odom'])) as writer:
        pass
    [topic] = Bag([tmp_path / 'mcap']).topics
    assert topic.offered == (OfferedQos(True, True, 10),)
    with Writer(tmp_path / 'sqlite', version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection('/odom', kind, typestore=jazzy())
        writer.write(connection, EPOCH, STREAM[0][3])
    [topic] = Bag([tmp_path / 'sqlite']).topics
    assert topic.offered == ()
