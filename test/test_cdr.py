# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Image messages from serialized bytes."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.errors import ImageError
from gip_localizer.io.bags.writer import make, make_header
from gip_localizer.io.cdr import image_of, jazzy
from gip_localizer.io.images import grey_image


def serialized(pixels: np.ndarray) -> bytes:
    height, width = pixels.shape
    message = make(
        'sensor_msgs/msg/Image', header=make_header(5, 'camera'), height=height, width=width,
        encoding='mono8', is_bigendian=0, step=width, data=pixels.ravel(),
    )
    return bytes(jazzy().serialize_cdr(message, 'sensor_msgs/msg/Image'))


def test_the_pixels_come_back():
    pixels = np.arange(12, dtype=np.uint8).reshape(3, 4)
    message = image_of(serialized(pixels), 'Image')
    assert message.header.frame_id == 'camera'
    np.testing.assert_array_equal(grey_image(message), pixels)


def test_an_image_of_no_pixels_is_a_message():
    assert image_of(serialized(np.zeros((0, 4), np.uint8)), 'Image').data.size == 0


@pytest.mark.parametrize('damage', [
    lambda good: b'', lambda good: good[:3], lambda good: good[:40], lambda good: good[:-9],
    lambda good: b'\x07\x07' + good[2:], lambda good: good + bytes(64),
    lambda good: good[:4] + b'\xff' * (len(good) - 4),
])  # fmt: skip
def test_bytes_that_are_no_image_are_named(damage):
    bad = damage(serialized(np.zeros((3, 4), np.uint8)))
    with pytest.raises(ImageError, match=f'{len(bad)} bytes are no sensor_msgs/msg/Image'):
        image_of(bad, 'Image')


def test_random_bytes_are_never_worse_than_an_image_error():
    rng = np.random.default_rng(3)
    good = serialized(np.zeros((3, 4), np.uint8))
    for _ in range(2000):
        bad = bytearray(good)
        for place in rng.integers(0, len(bad), rng.integers(1, 6)):
            bad[place] = rng.integers(256)
        try:
            message = image_of(bytes(bad), 'Image')
        except ImageError:
            continue
        assert message.data.dtype == np.uint8
