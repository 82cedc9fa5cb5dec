# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""16 bit pictures that use less: scaled by what the camera uses, not by what one frame shows."""

from __future__ import annotations

from drive_samples import recorded, replayed, rewritten
import numpy as np
import pytest

from gip_localizer.io.bit_depth import BitDepth
from gip_localizer.io.cdr import jazzy
from gip_localizer.io.images import grey_image

IMAGE = 'sensor_msgs/msg/Image'


@pytest.mark.parametrize(('largest', 'bits'), [
    (0, 8), (255, 8), (256, 10), (1023, 10), (4095, 12), (16383, 14), (16384, 16), (65535, 16),
])
def test_an_image_is_scaled_by_the_bits_it_uses(largest, bits):
    image = np.array([[0, largest]], np.uint16)
    depth = BitDepth()
    scaled = depth.scaled(image)
    assert depth.bits == bits
    assert scaled.max() == (largest if bits == 8 else largest << (16 - bits))
    assert scaled.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert bool(depth.note(image)) == (bits < 16)


def test_a_dark_image_is_scaled_as_those_before_and_8_bits_pass_as_they_are():
    depth = BitDepth()
    depth.scaled(np.array([[4000]], np.uint16))
    assert depth.scaled(np.array([[7]], np.uint16)).max() == 7 << 4
    eight = np.array([[7]], np.uint8)
    assert depth.scaled(eight) is eight
    assert depth.note(eight) == ''


def widened(drive, path, bits):
    messages = []
    for topic, kind, log, raw in recorded(drive):
        if kind == IMAGE:
            message = jazzy().deserialize_cdr(raw, kind)
            pixels = grey_image(message).astype(np.uint16) << (bits - 8)
            message.encoding, message.step = 'mono16', 2 * message.width
            message.data = pixels.astype('<u2').view(np.uint8).ravel()
            raw = jazzy().serialize_cdr(message, kind)
        messages.append((topic, kind, log, raw))
    return rewritten(path, messages)


@pytest.mark.parametrize('bits', [8, 10])
def test_a_drive_of_few_bits_is_localized_as_that_of_eight(drive, whole, tmp_path, capsys, bits):
    _, given = whole
    bag = widened(drive, tmp_path / 'few.mcap', bits)
    few = replayed(bag, drive, tmp_path / 'few')
    assert few['published'] == given['published']
    assert few['rmse_xy_m'] == pytest.approx(given['rmse_xy_m'], rel=0.1)
    assert f'16 bit images use {bits} bits' in capsys.readouterr().err
