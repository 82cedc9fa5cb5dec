# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import struct
import tracemalloc
import zlib

import cv2
from match_samples import texture
import numpy as np
import pytest

from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError, OutputError
from gip_localizer.io.map_files import load_map, save_map

GOOD = 'image: map.png\nresolution: 0.05\norigin: [1.5, -2.0, 0.3]\nnegate: 0\n'
GREY8 = (texture((20, 30)) * 255).astype(np.uint8)
GREY16 = (texture((20, 30)) * 65535).astype(np.uint16)


def write(folder, text=GOOD, pixels=GREY8, name='map.png'):
    if pixels is not None:
        assert cv2.imwrite(str(folder / name), pixels)
    path = folder / 'map.yaml'
    path.write_text(text, encoding='utf-8')
    return path


@pytest.mark.parametrize('pixels', [GREY8, GREY16], ids=['8 bit', '16 bit'])
@pytest.mark.parametrize('name', ['map.png', 'map.pgm', 'map.tiff'])
def test_a_map_is_read_at_its_full_depth(tmp_path, pixels, name):
    raster_map = load_map(write(tmp_path, GOOD.replace('map.png', name), pixels, name))
    np.testing.assert_array_equal(raster_map.grey, pixels)
    assert raster_map.grey.dtype == pixels.dtype
    assert raster_map.resolution == 0.05
    assert raster_map.origin == Pose2(1.5, -2.0, 0.3)
    assert raster_map.valid is None


@pytest.mark.parametrize('pixels', [GREY8, GREY16], ids=['8 bit', '16 bit'])
def test_negate_inverts(tmp_path, pixels):
    raster_map = load_map(write(tmp_path, GOOD.replace('negate: 0', 'negate: 1'), pixels))
    np.testing.assert_array_equal(raster_map.grey, np.iinfo(pixels.dtype).max - pixels)


@pytest.mark.parametrize('pixels', [GREY8, GREY16], ids=['8 bit', '16 bit'])
def test_alpha_zero_is_no_data(tmp_path, pixels):
    alpha = np.full(pixels.shape, np.iinfo(pixels.dtype).max, pixels.dtype)
    alpha[5:9, 2:20] = 0
    alpha[0, 0] = 1  # barely there is there
    raster_map = load_map(write(tmp_path, pixels=np.dstack([pixels] * 3 + [alpha])))
    np.testing.assert_array_equal(raster_map.valid, alpha > 0)
    np.testing.assert_allclose(raster_map.grey.astype(int), pixels, atol=1)
    assert raster_map.grey.dtype == pixels.dtype


def test_grey_with_alpha_is_no_data_too(tmp_path):
    alpha = np.full(GREY8.shape, 255, np.uint8)
    alpha[3] = 0
    path = write(tmp_path, pixels=None)
    (tmp_path / 'map.png').write_bytes(png(GREY8, alpha))
    raster_map = load_map(path)
    np.testing.assert_array_equal(raster_map.valid, alpha > 0)
    np.testing.assert_allclose(raster_map.grey.astype(int), GREY8, atol=1)


def test_colour_becomes_grey_and_full_alpha_is_no_mask(tmp_path):
    colour = np.dstack([GREY8, GREY8, GREY8, np.full_like(GREY8, 255)])
    raster_map = load_map(write(tmp_path, pixels=colour))
    assert raster_map.valid is None
    np.testing.assert_allclose(raster_map.grey.astype(int), GREY8, atol=1)


def test_an_image_may_lie_elsewhere(tmp_path):
    (tmp_path / 'pictures').mkdir()
    assert cv2.imwrite(str(tmp_path / 'pictures' / 'a.png'), GREY8)
    for name in ('pictures/a.png', str(tmp_path / 'pictures' / 'a.png')):
        path = write(tmp_path, GOOD.replace('map.png', name), None)
        np.testing.assert_array_equal(load_map(path).grey, GREY8)


MASK = texture((20, 30)) > 0.3


@pytest.mark.parametrize('grey', [GREY8, GREY16, texture((20, 30))],
                         ids=['8 bit', '16 bit', 'float'])
@pytest.mark.parametrize('valid', [None, MASK], ids=['full', 'masked'])
def test_maps_come_back_from_disk(tmp_path, grey, valid):
    raster_map = RasterMap(grey, 0.02, Pose2(-3.25, 7.5, -1.2), valid)
    save_map(raster_map, tmp_path / 'deep' / 'town.yaml')
    back = load_map(tmp_path / 'deep' / 'town.yaml')
    assert back.resolution == 0.02
    assert back.origin == raster_map.origin
    expected = grey if grey.dtype != np.float32 else np.round(grey * 65535)
    np.testing.assert_allclose(back.grey.astype(float), expected, atol=1)
    if valid is None:
        assert back.valid is None
    else:
        np.testing.assert_array_equal(back.valid, valid)


def test_saving_does_not_overwrite_unless_told(tmp_path):
    path = tmp_path / 'map.yaml'
    save_map(RasterMap(GREY8, 0.05), path)
    before = (tmp_path / 'map.png').read_bytes()
    other = RasterMap(255 - GREY8, 0.05)
    with pytest.raises(OutputError, match='exists'):
        save_map(other, path)
    path.unlink()
    with pytest.raises(OutputError, match=r'map\.png exists'):
        save_map(other, path)
    assert (tmp_path / 'map.png').read_bytes() == before
    save_map(other, path, force=True)
    np.testing.assert_array_equal(load_map(path).grey, 255 - GREY8)


def test_a_map_that_cannot_be_written_leaves_nothing(tmp_path):
    (tmp_path / 'file').write_text('')
    with pytest.raises(OutputError, match='cannot be written'):
        save_map(RasterMap(GREY8, 0.05), tmp_path / 'file' / 'map.yaml')
    assert [p.name for p in tmp_path.iterdir()] == ['file']


BAD_YAML = {
    'empty': ('', 'image, resolution, origin'),
    'a list': ('- 1\n- 2\n', 'image, resolution, origin'),
    'a word': ('hello', 'image, resolution, origin'),
    'broken': ('image: [map.png\nresolution: 1', 'not valid YAML'),
    'python object': ('image: !!python/object/apply:os.getcwd []\n', 'not valid YAML'),
    'tab': ('image: map.png\n\tresolution: 1', 'not valid YAML'),
    'python object, in one line': ('image: !!python/object/apply:os.getcwd []\n', r'^[^\n]*$'),
    'a list, named in the message': ('- 1\n- 2\n', 'holds a list'),
    'nothing, named in the message': ('', 'holds nothing'),
    'quoted nan': (GOOD.replace('0.05', '"nan"'), "resolution holds 'nan'"),
    'image of an endless name': (GOOD.replace('map.png', 'm' * 5000), 'cannot be read'),
    'nested': ('[' * 700, 'not valid YAML'),
    'no image': (GOOD.replace('image: map.png', 'picture: map.png'), 'no image; found picture'),
    'no resolution': (GOOD.replace('resolution', 'Resolution'), 'no resolution'),
    'no origin': (GOOD.replace('origin', 'origins'), 'no origin'),
    'zero resolution': (GOOD.replace('0.05', '0.0'), 'resolution is 0'),
    'negative resolution': (GOOD.replace('0.05', '-1'), 'resolution is -1'),
    'resolution of nanometres': (GOOD.replace('0.05', '5e-9'), 'resolution is 5e-09'),
    'resolution of a town': (GOOD.replace('0.05', '1e9'), r'resolution is 1e\+09; expected met'),
    'odd mode': (GOOD + 'mode: foo\n', "mode is 'foo'; expected trinary"),
    'number of mode': (GOOD + 'mode: 7\n', 'mode is 7'),
    'list of modes': (GOOD + 'mode: [raw]\n', 'mode is'),
    'nan resolution': (GOOD.replace('0.05', '.nan'), "resolution holds 'nan'"),
    'infinite resolution': (GOOD.replace('0.05', '.inf'), "resolution holds 'inf'"),
    'huge resolution': (GOOD.replace('0.05', '1' + '0' * 400), "resolution holds '1000"),
    'resolution in words': (GOOD.replace('0.05', 'fine'), "resolution holds 'fine'"),
    'true resolution': (GOOD.replace('0.05', 'true'), "resolution holds 'True'"),
    'no number of resolution': (GOOD.replace('0.05', ''), "resolution holds 'None'"),
    'short origin': (GOOD.replace('[1.5, -2.0, 0.3]', '[1.5, -2.0]'), 'origin'),
    'origin of words': (GOOD.replace('-2.0', 'b'), "origin holds 'b'"),
    'origin with nan': (GOOD.replace('-2.0', '.nan'), "origin holds 'nan'"),
    'scalar origin': (GOOD.replace('[1.5, -2.0, 0.3]', '0.0'), 'origin is 0.0'),
    'odd negate': (GOOD.replace('negate: 0', 'negate: 2'), 'negate is 2'),
    'negate list': (GOOD.replace('negate: 0', 'negate: [1]'), 'negate is'),
    'image number': (GOOD.replace('map.png', '7'), 'image is 7'),
    'image missing': (GOOD.replace('map.png', 'other.png'), 'does not exist'),
    'image is a folder': (GOOD.replace('map.png', '.'), 'is a folder'),
}


@pytest.mark.parametrize('fault', BAD_YAML)
def test_a_bad_map_yaml_is_refused_with_file_and_fault(tmp_path, fault):
    text, word = BAD_YAML[fault]
    path = write(tmp_path, text)
    with pytest.raises(MapError, match=word) as caught:
        load_map(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize('number', ['5e-2', '"0.05"', "'5.0e-2'"])
def test_numbers_are_read_as_map_server_reads_them(tmp_path, number):
    text = GOOD.replace('0.05', number).replace('1.5', '15e-1')
    raster_map = load_map(write(tmp_path, text))
    assert raster_map.resolution == 0.05
    assert raster_map.origin == Pose2(1.5, -2.0, 0.3)


def test_a_map_that_is_transparent_all_over_is_refused(tmp_path):
    nothing = np.dstack([GREY8] * 3 + [np.zeros_like(GREY8)])
    with pytest.raises(MapError, match='transparent all over'):
        load_map(write(tmp_path, pixels=nothing))


@pytest.mark.parametrize('mode', ['trinary', 'scale', 'raw'])
def test_the_modes_of_occupancy_are_all_the_same_to_it(tmp_path, mode):
    np.testing.assert_array_equal(load_map(write(tmp_path, GOOD + f'mode: {mode}\n')).grey, GREY8)


def test_a_missing_or_binary_yaml_is_refused(tmp_path):
    with pytest.raises(MapError, match='cannot be read'):
        load_map(tmp_path / 'nothing.yaml')
    with pytest.raises(MapError, match='cannot be read'):
        load_map(tmp_path)
    (tmp_path / 'image.yaml').write_bytes(bytes(range(256)))
    with pytest.raises(MapError, match=r'image\.yaml'):
        load_map(tmp_path / 'image.yaml')


def chunk(kind: bytes, content: bytes) -> bytes:
    checksum = zlib.crc32(kind + content)
    return struct.pack('>I', len(content)) + kind + content + struct.pack('>I', checksum)


def png(grey: np.ndarray, alpha: np.ndarray | None = None,
        declared: tuple[int, int] | None = None) -> bytes:
    """A PNG from first principles: grey or grey with alpha, of any declared size."""
    height, width = grey.shape
    pixels = grey[..., None] if alpha is None else np.stack([grey, alpha], -1)
    rows = b''.join(b'\0' + pixels[r].tobytes() for r in range(height))
    size = declared or (width, height)
    header = struct.pack('>IIBBBBB', *size, 8, 0 if alpha is None else 4, 0, 0, 0)
    return (b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(rows))
            + chunk(b'IEND', b''))


BAD_IMAGES = {
    'empty': b'',
    'text': b'this is no picture',
    'header only': png(GREY8)[:30],
    'zeros': bytes(1000),
}


@pytest.mark.parametrize('fault', BAD_IMAGES)
def test_an_unreadable_image_is_refused(tmp_path, fault):
    path = write(tmp_path, pixels=None)
    (tmp_path / 'map.png').write_bytes(BAD_IMAGES[fault])
    with pytest.raises(MapError, match=r'map\.png cannot be read'):
        load_map(path)


@pytest.mark.parametrize('suffix', ['.png', '.jpg', '.pgm', '.tiff', '.bmp'])
def test_an_image_that_was_cut_off_is_refused(tmp_path, suffix):
    name = 'map' + suffix
    path = write(tmp_path, GOOD.replace('map.png', name), cv2.resize(GREY8, (300, 200)), name)
    assert load_map(path).grey.shape == (200, 300)
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) * 2 // 3])
    with pytest.raises(MapError, match=r'cannot be read|cut off'):
        load_map(path)


@pytest.mark.parametrize('suffix', ['.hdr', '.tiff'])
def test_images_of_real_numbers_are_refused(tmp_path, suffix):
    grey = texture((8, 8))
    name = 'map' + suffix
    path = write(tmp_path, GOOD.replace('map.png', name), np.dstack([grey] * 3), name)
    with pytest.raises(MapError, match='8 or 16 bit'):
        load_map(path)


@pytest.mark.parametrize('size', [(200_000, 200_000), (2**31 - 1, 2**31 - 1), (60_000, 60_000)])
def test_a_huge_declared_map_is_refused_without_its_memory(tmp_path, size):
    path = write(tmp_path, pixels=None)
    (tmp_path / 'map.png').write_bytes(png(GREY8, declared=size))
    tracemalloc.start()
    try:
        with pytest.raises(MapError, match=r'^[^\n]*map\.png[^\n]*; expected[^\n]*$'):
            load_map(path)
        assert tracemalloc.get_traced_memory()[1] < 50e6
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16, np.float32])
def test_the_noise_of_a_map_comes_back(tmp_path, dtype):
    white = {np.uint8: 255, np.uint16: 65535}.get(dtype, 1.0)
    noise = (texture((20, 30)) * 0.2 * white).astype(dtype)
    saved = RasterMap(GREY16, 0.05, Pose2(1.5, -2.0, 0.3), noise=noise)
    save_map(saved, tmp_path / 'road.yaml')
    found = load_map(tmp_path / 'road.yaml').noise
    assert found is not None
    depth = 255 if dtype is np.uint8 else 65535
    np.testing.assert_allclose(found / depth, noise / white, atol=1.0 / depth)


@pytest.mark.parametrize(('value', 'pixels', 'word'), [
    ('noise.png', None, 'does not exist'), ('noise.png', GREY8[:10], '30x10'),
    ('7', GREY8, 'file name'),
])
def test_a_noise_that_cannot_be_used_is_refused(tmp_path, value, pixels, word):
    path = write(tmp_path, f'{GOOD}noise: {value}\n')
    if pixels is not None:
        cv2.imwrite(str(tmp_path / 'noise.png'), pixels)
    with pytest.raises(MapError, match=f'noise.*{word}'):
        load_map(path)
