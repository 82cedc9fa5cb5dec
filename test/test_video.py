# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""H.264 and H.265: what is decoded, and what is refused until the next key frame."""

from __future__ import annotations

import sys

from drive_samples import recorded, replayed, rewritten
from message_samples import compressed_message
import numpy as np
import pytest

pytest.importorskip('av', reason='PyAV is the extra `video`')

from video_samples import encoded, pictures

from gip_localizer.cli import main
from gip_localizer.errors import ImageError
from gip_localizer.io.cdr import image_of, jazzy
from gip_localizer.io.foxglove_video import VIDEO
from gip_localizer.io.image_stream import ImageStream
from gip_localizer.io.images import compressed_grey_image, grey_image

CODECS = ['h264', 'h265']
PICTURES = pictures(25)


class Reader:
    """What a stream gives for each packet: the image, or the reason why there is none."""

    def __init__(self, codec):
        self.codec, self.stream = codec, ImageStream()

    def read(self, packet):
        message = compressed_message(packet)
        message.format = self.codec
        try:
            return compressed_grey_image(self.stream.taken(message))
        except ImageError as error:
            return str(error)


def outcomes(codec, packets):
    reader = Reader(codec)
    return [reader.read(packet) for packet in packets]


def alike(image, picture):
    """Whether an image shows a picture, at whatever range of grey."""
    return image.shape == picture.shape and np.corrcoef(
        image.ravel(), picture.ravel()
    )[0, 1] > 0.995


@pytest.fixture(scope='module', params=CODECS)
def stream(request):
    return request.param, encoded(request.param, PICTURES)


def test_every_picture_comes_with_its_packet(stream):
    codec, packets = stream
    read = outcomes(codec, packets)
    assert all(map(alike, read, PICTURES))
    # None is a neighbour: the texture moves by a pixel.
    assert not alike(read[3], PICTURES[4])


def test_a_stream_is_joined_at_its_next_key_frame(stream):
    codec, packets = stream
    read = outcomes(codec, packets[3:])
    assert all('key frame' in one for one in read[:7])
    assert all(map(alike, read[7:], PICTURES[10:]))


@pytest.mark.parametrize('lost', [1, 6, 9])
def test_after_a_lost_packet_nothing_is_used_until_the_next_key_frame(stream, lost):
    codec, packets = stream
    read = outcomes(codec, packets[:lost] + packets[lost + 1 :])
    after = 10 - lost - 1
    assert all(map(alike, read[:lost], PICTURES))
    if after:
        assert 'lacks a packet' in read[lost]
        assert 'qos_overrides' in read[lost]
    assert all(isinstance(one, str) for one in read[lost : lost + after])
    assert all(map(alike, read[lost + after :], PICTURES[10:]))


def test_a_lost_key_frame_a_repeated_and_a_damaged_packet_are_noticed(stream):
    codec, packets = stream
    read = outcomes(codec, packets[:10] + packets[11:])
    assert all(isinstance(one, str) for one in read[10:19])
    assert all(map(alike, read[19:], PICTURES[20:]))
    repeated = outcomes(codec, [*packets[:3], packets[2], *packets[3:]])
    assert 'repeats picture' in repeated[3]
    assert all(map(alike, repeated[4:], PICTURES[3:]))
    for damaged in (b'', b'\x00' * 40, packets[4][:5], b'\xff' * 200):
        read = outcomes(codec, [*packets[:4], damaged, *packets[5:]])
        assert all(isinstance(one, str) for one in read[4:10])
        assert all(map(alike, read[10:], PICTURES[10:]))


@pytest.mark.parametrize('codec', CODECS)
def test_b_frames_are_refused_by_name(codec):
    read = outcomes(codec, encoded(codec, PICTURES, b_frames=2))
    assert any('B-frames' in one for one in read if isinstance(one, str))
    for image in (one for one in read if not isinstance(one, str)):
        assert any(alike(image, picture) for picture in PICTURES)


def test_ten_bits_are_read(stream):
    codec, _ = stream
    packets = encoded(codec, PICTURES[:3], pixel_format='yuv420p10le')
    read = outcomes(codec, packets)
    assert read[0].dtype == np.uint16
    assert all(map(alike, read, PICTURES))


def test_length_prefixed_packets_and_a_missing_decoder_are_named(stream, monkeypatch):
    codec, packets = stream
    prefixed = len(packets[0]).to_bytes(4, 'big') + packets[0][4:].replace(b'\0\0\1', b'abc')
    assert 'Annex B' in Reader(codec).read(prefixed)
    monkeypatch.setitem(sys.modules, 'av', None)
    assert "pip install 'gip_localizer[video]'" in Reader(codec).read(packets[0])


@pytest.mark.parametrize('kind', ['sensor_msgs/msg/CompressedImage', VIDEO])
def test_replay_and_map_use_a_recorded_video(drive, tmp_path, kind):
    """The drive's images as H.264: as the raw ones, within what the compression takes."""
    messages = recorded(drive)
    raws = [image_of(raw, 'Image') for topic, _, _, raw in messages if topic == '/image']
    packets = iter(encoded('h264', [grey_image(one) for one in raws], gop=5))
    rest = []
    for topic, msgtype, log, raw in messages:
        if topic != '/image':
            rest.append((topic, msgtype, log, raw))
            continue
        header = image_of(raw, 'Image').header
        data = np.frombuffer(next(packets), np.uint8)
        stamped = {'timestamp': header.stamp, 'frame_id': 'camera'} if kind == VIDEO else {
            'header': header}
        message = jazzy().types[kind](format='h264', data=data, **stamped)
        rest.append(('/image/video', kind, log, bytes(jazzy().serialize_cdr(message, kind))))
    bag = rewritten(tmp_path / 'video.mcap', rest)
    metrics = replayed(bag, drive, tmp_path / 'out')
    assert metrics['published'] >= 24
    assert metrics['rmse_xy_m'] < 0.03
    assert metrics['wrong_published'] == 0
    if kind == VIDEO:
        return
    road = tmp_path / 'road.yaml'
    assert main(['map', str(bag), '--params', str(drive / 'params.yaml'), '--resolution', '0.1',
                 '--no-pose-check', '--out', str(road)]) == 0
    assert road.is_file()
