# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import array
import math
import struct
import zlib

import cv2
from hypothesis import given, settings
from hypothesis import strategies as st
from message_samples import compressed_message, image_message
import numpy as np
import pytest

from gip_localizer.errors import ImageError
from gip_localizer.io.images import CHROMA_ROWS, compressed_grey_image, grey_image, LAYOUTS

RNG = np.random.default_rng(4)
HEIGHT, WIDTH = 12, 18
GREY8 = RNG.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
GREY16 = RNG.integers(0, 65536, (HEIGHT, WIDTH), np.uint16)
COLOUR = RNG.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)  # blue, green, red
WITH_ALPHA = np.dstack([COLOUR, RNG.integers(0, 256, (HEIGHT, WIDTH), np.uint8)])
PADDINGS = [0, 1, 7]


@pytest.mark.parametrize('pad', PADDINGS)
@pytest.mark.parametrize('encoding', ['mono8', '8UC1'])
def test_grey_bytes_pass_as_they_are(encoding, pad):
    np.testing.assert_array_equal(grey_image(image_message(GREY8, encoding, pad=pad)), GREY8)


@pytest.mark.parametrize('pad', PADDINGS)
@pytest.mark.parametrize('big_endian', [False, True])
@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
def test_sixteen_bits_are_read_in_either_byte_order(encoding, big_endian, pad):
    message = image_message(GREY16, encoding, pad=pad, big_endian=big_endian)
    grey = grey_image(message)
    assert grey.dtype == np.uint16
    np.testing.assert_array_equal(grey, GREY16)


@pytest.mark.parametrize('pad', PADDINGS)
@pytest.mark.parametrize(('encoding', 'pixels', 'code'), [
    ('bgr8', COLOUR, cv2.COLOR_BGR2GRAY),
    ('8UC3', COLOUR, cv2.COLOR_BGR2GRAY),
    ('rgb8', COLOUR, cv2.COLOR_RGB2GRAY),
    ('bgra8', WITH_ALPHA, cv2.COLOR_BGRA2GRAY),
    ('8UC4', WITH_ALPHA, cv2.COLOR_BGRA2GRAY),
    ('rgba8', WITH_ALPHA, cv2.COLOR_RGBA2GRAY),
])
def test_colours_become_grey_as_opencv_weighs_them(encoding, pixels, code, pad):
    message = image_message(pixels, encoding, pad=pad)
    np.testing.assert_array_equal(grey_image(message), cv2.cvtColor(pixels, code))


def test_red_and_blue_are_not_taken_for_each_other():
    pure_red = np.zeros((4, 4, 3), np.uint8)
    pure_red[..., 0] = 255
    assert grey_image(image_message(pure_red, 'rgb8'))[0, 0] == 76
    assert grey_image(image_message(pure_red, 'bgr8'))[0, 0] == 29


def mosaic(pattern: str, red: int, green: int, blue: int) -> np.ndarray:
    """A flat colour behind a colour filter; the pattern is read from the top-left pixel."""
    level = {'r': red, 'g': green, 'b': blue}
    tile = np.array([[level[pattern[0]], level[pattern[1]]],
                     [level[pattern[2]], level[pattern[3]]]], np.uint8)
    return np.tile(tile, (HEIGHT // 2, WIDTH // 2))


@pytest.mark.parametrize('pad', PADDINGS)
@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
@pytest.mark.parametrize('colour', [(250, 0, 0), (0, 250, 0), (0, 0, 250), (200, 100, 40)])
def test_bayer_mosaics_of_a_flat_colour_are_its_grey(pattern, colour, pad):
    red, green, blue = colour
    message = image_message(mosaic(pattern, *colour), f'bayer_{pattern}8', pad=pad)
    expected = 0.299 * red + 0.587 * green + 0.114 * blue
    np.testing.assert_allclose(grey_image(message)[2:-2, 2:-2], expected, atol=1.5)


@pytest.mark.parametrize('pad', PADDINGS)
@pytest.mark.parametrize(('encoding', 'code'), [
    ('yuv422', cv2.COLOR_YUV2GRAY_UYVY), ('uyvy', cv2.COLOR_YUV2GRAY_UYVY),
    ('yuv422_yuy2', cv2.COLOR_YUV2GRAY_YUY2), ('yuyv', cv2.COLOR_YUV2GRAY_YUY2),
])
def test_yuv_gives_its_luminance(encoding, code, pad):
    pairs = RNG.integers(0, 256, (HEIGHT, WIDTH, 2), np.uint8)
    message = image_message(pairs, encoding, pad=pad)
    np.testing.assert_array_equal(grey_image(message), cv2.cvtColor(pairs, code))


@pytest.mark.parametrize('encoding', sorted(LAYOUTS))
@pytest.mark.parametrize('size', [(1, 1), (1, 3), (2, 2), (3, 3), (480, 4)])
def test_every_encoding_works_at_small_sizes_and_without_the_last_padding(encoding, size):
    channels, depth = LAYOUTS[encoding]
    colour_rows = math.ceil(CHROMA_ROWS.get(encoding, 0) * size[0] / 2)
    rows = RNG.integers(0, 256, (size[0] + colour_rows, size[1] * channels * depth), np.uint8)
    message = image_message(rows, encoding, width=size[1], pad=5)
    message.height = size[0]
    whole = grey_image(message)
    assert whole.shape == size
    message.data = message.data[:-5]
    np.testing.assert_array_equal(grey_image(message), whole)


def test_grey_bytes_are_not_copied():
    message = image_message(GREY8, 'mono8', pad=3)
    assert np.shares_memory(grey_image(message), message.data)


def test_messages_of_rclpy_are_read_alike():
    Image = pytest.importorskip('sensor_msgs.msg').Image
    message = Image(height=HEIGHT, width=WIDTH, encoding='bgr8', step=WIDTH * 3)
    message.data = array.array('B', COLOUR.tobytes())
    expected = cv2.cvtColor(COLOUR, cv2.COLOR_BGR2GRAY)
    np.testing.assert_array_equal(grey_image(message), expected)


@pytest.mark.parametrize(('changes', 'word'), [
    ({'encoding': 'jpeg'}, "'jpeg' is not supported; expected one of 16UC1"),
    ({'encoding': ''}, 'not supported'),
    ({'encoding': '32FC1'}, 'not supported'),
    ({'encoding': 'MONO8'}, 'not supported'),
    ({'height': 0}, 'size is 18x0'),
    ({'width': 0}, 'size is 0x12'),
    ({'step': 0}, 'step is 0 bytes'),
    ({'step': 17}, 'row of 18 mono8 pixels takes 18'),
    ({'width': 2**31}, 'size is'),
    ({'height': 2**32 - 1, 'width': 2**32 - 1}, 'size is'),
    ({'step': 2**32 - 1}, 'holds 216 bytes'),
    ({'height': 13}, 'holds 216 bytes'),
    ({'data': np.zeros(0, np.uint8)}, 'holds 0 bytes'),
    ({'encoding': 'bgr8'}, 'step is 18 bytes'),
    ({'encoding': 'mono16'}, 'step is 18 bytes'),
])
def test_unusable_images_are_refused(changes, word):
    message = image_message(GREY8, 'mono8')
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(ImageError, match=word):
        grey_image(message)


@settings(max_examples=60)
@given(
    st.sampled_from([*LAYOUTS, 'nonsense']), st.integers(0, 9), st.integers(0, 9),
    st.integers(0, 60), st.binary(max_size=300), st.integers(0, 1),
)
def test_whatever_the_numbers_an_image_is_read_or_refused(encoding, height, width, step, content,
                                                          order):
    message = image_message(GREY8, encoding)
    message.height, message.width, message.step = height, width, step
    message.is_bigendian, message.data = order, np.frombuffer(content, np.uint8)
    try:
        grey = grey_image(message)
    except ImageError:
        return
    assert grey.shape == (height, width)


def test_of_luminance_and_colour_planes_the_luminance_is_taken():
    rows = RNG.integers(0, 256, (HEIGHT, WIDTH), np.uint8)
    for encoding, colour in (('nv12', HEIGHT // 2), ('nv21', HEIGHT // 2), ('nv24', 2 * HEIGHT)):
        whole = np.vstack([rows, RNG.integers(0, 256, (colour, WIDTH), np.uint8)])
        message = image_message(whole, encoding, pad=6)
        message.height = HEIGHT
        np.testing.assert_array_equal(grey_image(message), rows)
        message.data = message.data[: -2 * message.step]
        with pytest.raises(ImageError, match='take'):
            grey_image(message)


@pytest.mark.parametrize('big_endian', [False, True])
@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
def test_bayer_mosaics_of_sixteen_bits_keep_their_depth(pattern, big_endian):
    pixels = mosaic(pattern, 200, 100, 40).astype(np.uint16) * 256 + 77
    grey = grey_image(image_message(pixels, f'bayer_{pattern}16', big_endian=big_endian))
    assert grey.dtype == np.uint16
    expected = (0.299 * 200 + 0.587 * 100 + 0.114 * 40) * 256 + 77
    np.testing.assert_allclose(grey[2:-2, 2:-2], expected, atol=2.0)


@pytest.mark.parametrize(('encoding', 'code'), [
    ('rgb16', cv2.COLOR_RGB2GRAY), ('bgr16', cv2.COLOR_BGR2GRAY), ('16UC3', cv2.COLOR_BGR2GRAY),
])
def test_colours_of_sixteen_bits_keep_their_depth(encoding, code):
    pixels = RNG.integers(0, 65536, (HEIGHT, WIDTH, 3), np.uint16)
    grey = grey_image(image_message(pixels, encoding, pad=2))
    np.testing.assert_array_equal(grey, cv2.cvtColor(pixels, code))


COARSE = RNG.integers(0, 256, (6, 8), np.uint8)
SMOOTH = cv2.resize(COARSE, (64, 48), interpolation=cv2.INTER_CUBIC)
JPEG = cv2.imencode('.jpg', SMOOTH)[1].tobytes()
PNG = cv2.imencode('.png', SMOOTH)[1].tobytes()


@pytest.mark.parametrize(('content', 'slack'), [(JPEG, 12), (PNG, 0)], ids=['jpeg', 'png'])
@pytest.mark.parametrize('kind', ['jpeg', 'png', 'mono8; jpeg compressed ', ''])
def test_compressed_images_are_told_by_their_content(content, slack, kind):
    grey = compressed_grey_image(compressed_message(content, kind))
    assert grey.dtype == np.uint8
    np.testing.assert_allclose(grey.astype(int), SMOOTH, atol=slack)


def test_sixteen_bit_png_keeps_its_depth():
    content = cv2.imencode('.png', GREY16)[1].tobytes()
    np.testing.assert_array_equal(compressed_grey_image(compressed_message(content)), GREY16)


@pytest.mark.parametrize('suffix', ['.jpg', '.png'])
def test_compressed_colour_becomes_grey(suffix):
    colour = cv2.merge([SMOOTH, SMOOTH[::-1], SMOOTH[:, ::-1]])
    content = cv2.imencode(suffix, colour)[1].tobytes()
    grey = compressed_grey_image(compressed_message(content))
    expected = cv2.cvtColor(colour, cv2.COLOR_BGR2GRAY).astype(int)
    assert np.abs(grey - expected).mean() < 3.0


def test_compressed_messages_of_rclpy_are_read_alike():
    CompressedImage = pytest.importorskip('sensor_msgs.msg').CompressedImage
    message = CompressedImage(format='png')
    message.data = array.array('B', PNG)
    np.testing.assert_array_equal(compressed_grey_image(message), SMOOTH)


def png_header(width: int, height: int) -> bytes:
    header = struct.pack('>IIBBBBB', width, height, 8, 0, 0, 0, 0)
    head = struct.pack('>I', 13) + b'IHDR' + header
    return PNG[:8] + head + struct.pack('>I', zlib.crc32(b'IHDR' + header)) + PNG[33:]


def jpeg_of(width: int, height: int) -> bytes:
    """The sample with another size in its frame header."""
    place = JPEG.index(b'\xff\xc0')
    return JPEG[: place + 5] + struct.pack('>HH', height, width) + JPEG[place + 9 :]


@pytest.mark.parametrize(('content', 'word'), [
    (b'', 'of 0 bytes'),
    (b'\xff', 'cannot be decoded'),
    (b'\xff\xd8', 'cannot be decoded'),
    (b'\xff\xd8' + b'\xff' * 40, 'cannot be decoded'),
    (bytes(500), 'cannot be decoded'),
    (b'GIF89a' + bytes(100), 'cannot be decoded'),
    (cv2.imencode('.bmp', SMOOTH)[1].tobytes(), 'expected a whole jpeg or png'),
    (JPEG[:100], 'cannot be decoded|truncated'),
    (JPEG[: len(JPEG) // 2], 'cannot be decoded|truncated'),
    (JPEG[:-2], 'cannot be decoded|truncated'),
    (PNG[: len(PNG) // 2], 'cannot be decoded'),
    (PNG[:20], 'cannot be decoded'),
    (bytes(12) + PNG, 'cannot be decoded'),
    (png_header(100_000, 100_000), '100000x100000 pixels; too large'),
    (png_header(2**31 - 1, 2**31 - 1), 'too large'),
    (jpeg_of(30_000, 30_000), '30000x30000 pixels; too large'),
])
def test_corrupt_compressed_images_are_refused(content, word):
    with pytest.raises(ImageError, match=word):
        compressed_grey_image(compressed_message(content))


@settings(max_examples=60)
@given(st.sampled_from([JPEG, PNG]), st.integers(0, 2000), st.binary(min_size=1, max_size=8))
def test_damaged_files_are_read_or_refused(content, place, damage):
    place %= len(content)
    damaged = content[:place] + damage + content[place + len(damage) :]
    try:
        grey = compressed_grey_image(compressed_message(damaged))
    except ImageError:
        return
    assert grey.ndim == 2
    assert grey.size > 0


def test_a_jpeg_called_rgb8_is_named_as_one():
    jpeg = np.frombuffer(b'\xff\xd8\xff\xe0' + bytes(100), np.uint8)[np.newaxis]
    message = image_message(jpeg, 'mono8')
    message.encoding, message.height, message.width, message.step = 'rgb8', 48, 64, 192
    with pytest.raises(ImageError, match='begin like a JPEG'):
        grey_image(message)
