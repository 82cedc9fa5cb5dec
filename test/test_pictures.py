# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of maps as surveying programs write them: nodata, extra bands, senses and depths."""

from __future__ import annotations

import struct

import cv2
import numpy as np
import pytest

from gip_localizer.errors import MapError
from gip_localizer.io.map_files import load_map
from gip_localizer.io.pictures import read_picture
from gip_localizer.io.tiff import read_tiff_tags

RNG = np.random.default_rng(7)
SHAPE = (12, 17)
GREY = RNG.integers(1, 250, SHAPE).astype(np.uint8)
FULL = {np.uint8: 255, np.uint16: 65535}
DOUBLES = (33550, struct.pack('<3d', 0.05, 0.05, 0.0))
"""ModelPixelScale of GeoTIFF, which OpenCV does not know."""


def tiff(path, pixels, photometric=1, extra=None, nodata=None, order='<', big=False):
    """Write an uncompressed TIFF of one strip, with the tags that OpenCV cannot write."""
    bands = pixels[..., None] if pixels.ndim == 2 else pixels
    rows, cols, samples = bands.shape
    strip = bands.astype(bands.dtype.newbyteorder(order)).tobytes()
    words, offset = ('Q', 'Q') if big else ('H', 'I')
    body = bytearray()
    start = 16 if big else 8

    def shorts(*values):
        return 3, len(values), struct.pack(f'{order}{len(values)}H', *values)

    entries = {
        256: shorts(cols), 257: shorts(rows), 258: shorts(*[8 * bands.itemsize] * samples),
        259: shorts(1), 262: shorts(photometric), 273: (4, 1, struct.pack(f'{order}I', start)),
        277: shorts(samples), 278: shorts(rows), 279: (4, 1, struct.pack(f'{order}I', len(strip))),
        DOUBLES[0]: (12, 3, struct.pack(f'{order}3d', 0.05, 0.05, 0.0)),
    }
    if extra is not None:
        entries[338] = shorts(*extra)
    if nodata is not None:
        text = nodata.encode() + b'\0'
        entries[42113] = (2, len(text), text)
    body += strip + bytes(len(strip) % 2)
    listed = b''
    for tag, (kind, count, value) in sorted(entries.items()):
        room = struct.calcsize(f'{order}{offset}')
        if len(value) > room:
            place = start + len(body)
            body += value + bytes(len(value) % 2)
            value = struct.pack(order + offset, place)
        listed += struct.pack(f'{order}HH{offset}', tag, kind, count) + value.ljust(room, b'\0')
    head = (b'II' if order == '<' else b'MM') + (
        struct.pack(f'{order}HHHQ', 43, 8, 0, start + len(body)) if big
        else struct.pack(f'{order}HI', 42, start + len(body))
    )
    path.write_bytes(head + body + struct.pack(order + words, len(entries)) + listed
                     + struct.pack(order + offset, 0))
    return path


def of_depth(kind, pixels=GREY):
    return pixels.astype(kind) * kind(FULL[kind] // 255)


@pytest.mark.parametrize('order', ['<', '>'])
@pytest.mark.parametrize('big', [False, True])
@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_cells_with_the_nodata_value_are_not_known_and_no_tag_is_a_warning(
    tmp_path, capfd, kind, big, order
):
    pixels = of_depth(kind)
    pixels[3:6, 2:9] = 0
    path = tiff(tmp_path / 'map.tif', pixels, nodata='0', order=order, big=big)
    grey, valid = read_picture('the map', path)
    np.testing.assert_array_equal(grey, pixels)
    np.testing.assert_array_equal(valid, pixels > 0)
    assert capfd.readouterr().err == ''


@pytest.mark.parametrize('nodata', ['-9999', 'nan', '300', '0.5', 'none', '', None])
def test_a_nodata_value_that_no_cell_can_hold_marks_none(tmp_path, nodata):
    _, valid = read_picture('the map', tiff(tmp_path / 'map.tif', GREY, nodata=nodata))
    assert valid is None


def test_of_colours_all_three_must_hold_the_nodata_value(tmp_path):
    pixels = np.dstack([GREY] * 3)
    pixels[2, :, 0] = 255
    pixels[4] = 255
    _, valid = read_picture('the map', tiff(tmp_path / 'map.tif', pixels, 2, nodata='255'))
    assert not valid[4].any()
    assert valid.sum() == valid.size - SHAPE[1]


@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_a_fourth_band_that_is_said_to_be_something_else_is_no_alpha(tmp_path, kind):
    infrared = of_depth(kind)
    infrared[5] = 0
    pixels = np.dstack([of_depth(kind)] * 3 + [infrared])
    grey, valid = read_picture('the map', tiff(tmp_path / 'map.tif', pixels, 2, (0,)))
    assert valid is None
    np.testing.assert_allclose(grey.astype(float), pixels[..., 0], atol=FULL[kind] / 255)


@pytest.mark.parametrize('extra', [(1,), (2,), None])
@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_a_fourth_band_that_is_alpha_or_looks_like_it_marks_what_is_known(tmp_path, kind, extra):
    alpha = np.full(SHAPE, FULL[kind], kind)
    alpha[5] = 0
    pixels = np.dstack([of_depth(kind)] * 3 + [alpha])
    _, valid = read_picture('the map', tiff(tmp_path / 'map.tif', pixels, 2, extra))
    np.testing.assert_array_equal(valid, alpha > 0)


def test_a_fourth_band_of_unknown_kind_that_looks_like_a_picture_is_no_alpha(tmp_path):
    infrared = GREY.copy()
    infrared[5] = 0
    _, valid = read_picture('the map', tiff(
        tmp_path / 'map.tif', np.dstack([GREY] * 3 + [infrared]), 2
    ))
    assert valid is None


@pytest.mark.parametrize('bands', [2, 5])
def test_other_numbers_of_bands_are_refused_by_number(tmp_path, bands):
    path = tiff(tmp_path / 'map.tif', np.dstack([GREY] * bands), 1, (0,) * (bands - 1))
    with pytest.raises(MapError, match=rf'has {bands} bands.*gdal_translate -b 1'):
        read_picture('the map', path)


@pytest.mark.parametrize('kind', [np.uint8, np.uint16])
def test_where_white_is_zero_values_and_nodata_are_inverted(tmp_path, kind):
    stored = of_depth(kind)
    stored[1, 1] = 0
    path = tiff(tmp_path / 'map.tif', stored, 0, nodata='0')
    grey, valid = read_picture('the map', path)
    np.testing.assert_array_equal(grey, FULL[kind] - stored)
    np.testing.assert_array_equal(valid, stored > 0)


@pytest.mark.parametrize('damage', [b'', b'II*\0', b'II*\0\xff\xff\xff\xff', b'MM\0+' + bytes(12)])
def test_a_damaged_directory_has_no_tags(tmp_path, damage):
    path = tmp_path / 'map.tif'
    path.write_bytes(damage)
    assert read_tiff_tags(path) is None
    with pytest.raises(MapError, match='cannot be read'):
        read_picture('the map', path)


@pytest.mark.parametrize('largest', [15, 100, 255, 1023, 4095, 65535])
@pytest.mark.parametrize('kind', ['P2', 'P5', 'P7'])
def test_the_largest_value_of_a_pgm_is_white(tmp_path, kind, largest):
    values = RNG.integers(0, largest + 1, SHAPE)
    values[0, 0] = largest
    head = f'P7\nWIDTH {SHAPE[1]}\nHEIGHT {SHAPE[0]}\nDEPTH 1\nMAXVAL {largest}\n' \
        'TUPLTYPE GRAYSCALE\nENDHDR\n' if kind == 'P7' else \
        f'{kind}\n# by a scanner\n{SHAPE[1]} {SHAPE[0]}\n{largest}\n'
    raw = values.astype('>u2' if largest > 255 else 'u1').tobytes()
    if kind == 'P2':
        raw = ' '.join(map(str, values.ravel())).encode() + b'\n'
    (tmp_path / 'map.pgm').write_bytes(head.encode() + raw)
    grey, _ = read_picture('the map', tmp_path / 'map.pgm')
    full = 65535 if largest > 255 else 255
    np.testing.assert_allclose(grey, values * (full / largest), atol=1.0)


def test_a_colour_ppm_is_scaled_likewise(tmp_path):
    values = RNG.integers(0, 1024, (*SHAPE, 3))
    path = tmp_path / 'map.ppm'
    head = f'P6\n{SHAPE[1]} {SHAPE[0]}\n1023\n'
    path.write_bytes(head.encode() + values.astype('>u2').tobytes())
    expected = cv2.cvtColor((values * (65535 / 1023)).astype(np.uint16), cv2.COLOR_RGB2GRAY)
    np.testing.assert_allclose(read_picture('the map', path)[0], expected.astype(float), atol=2.0)


@pytest.mark.parametrize('bits', [8, 10, 11, 12, 16])
def test_a_map_of_sixteen_bits_is_scaled_by_those_it_uses(tmp_path, bits):
    values = RNG.integers(0, 1 << bits, SHAPE).astype(np.uint16)
    values[0, 0] = (1 << bits) - 1
    cv2.imwrite(str(tmp_path / 'map.png'), values)
    (tmp_path / 'map.yaml').write_text('image: map.png\nresolution: 0.05\norigin: [0, 0, 0]\n')
    grey = load_map(tmp_path / 'map.yaml').grey
    used = {11: 12}.get(bits, bits)
    if bits == 8:
        np.testing.assert_array_equal(grey, values.astype(np.uint8))
    else:
        np.testing.assert_array_equal(grey, values << (16 - used))
