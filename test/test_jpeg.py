# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a JPEG ends, and that one which the decoder repaired in silence is refused."""

from __future__ import annotations

import sys

import cv2
from message_samples import compressed_message
import numpy as np
import pytest

from gip_localizer.errors import ImageError, MapError
from gip_localizer.io import jpeg
from gip_localizer.io.images import compressed_grey_image
from gip_localizer.io.map_files import load_mask

NOISE = np.random.default_rng(1).integers(0, 255, (120, 160)).astype(np.uint8)
PICTURE = cv2.GaussianBlur(NOISE, (0, 0), 2.0)
COLOUR = np.dstack([PICTURE, PICTURE[::-1], PICTURE[:, ::-1]])
JPEG = cv2.imencode('.jpg', PICTURE)[1].tobytes()
HALF = len(JPEG) // 2
END = b'\xff\xd9'
THUMBNAIL = b'\xff\xe1' + (2 + len(JPEG)).to_bytes(2, 'big') + JPEG
KINDS = {
    'least quality': [cv2.IMWRITE_JPEG_QUALITY, 5], 'best': [cv2.IMWRITE_JPEG_QUALITY, 100],
    'progressive': [cv2.IMWRITE_JPEG_PROGRESSIVE, 1],
    'restarts': [cv2.IMWRITE_JPEG_RST_INTERVAL, 4],
}
BEHIND = {
    'zeros': bytes(4096), 'filling': b'\xff' * 999, 'another end': b'abc' + END + b'abc',
    'another picture': JPEG, 'one byte': b'\0',
}


def read(content):
    return compressed_grey_image(compressed_message(content))


@pytest.mark.parametrize('behind', BEHIND.values(), ids=BEHIND)
@pytest.mark.parametrize('kind', KINDS.values(), ids=KINDS)
def test_what_lies_behind_the_end_is_no_part_of_the_picture(kind, behind):
    for pixels in (PICTURE, COLOUR):
        content = cv2.imencode('.jpg', pixels, kind)[1].tobytes()
        assert jpeg.end_of(content + behind) == len(content)
        np.testing.assert_array_equal(read(content + behind), read(content))


@pytest.mark.parametrize('behind', [*BEHIND.values(), b''], ids=[*BEHIND, 'nothing'])
@pytest.mark.parametrize('share', [0.2, 0.5, 0.99])
def test_a_cut_picture_is_refused_whatever_lies_behind(share, behind):
    if behind == BEHIND['another end']:
        pytest.importorskip('simplejpeg')
    cut = JPEG[: int(share * len(JPEG))]
    with pytest.raises(ImageError, match=r'truncated|damaged'):
        read(cut + behind)


def test_the_end_of_a_thumbnail_is_not_the_end():
    content = JPEG[:2] + THUMBNAIL + JPEG[2:]
    assert jpeg.end_of(content) == len(content)
    assert jpeg.declared_size(content) == (160, 120)
    with pytest.raises(ImageError, match='truncated'):
        read(content[: len(THUMBNAIL) + 200])


@pytest.mark.parametrize('damaged', [
    JPEG[:HALF] + JPEG[HALF + 60:], JPEG[:HALF] + END, JPEG[:-40] + END,
], ids=['a piece is missing', 'half is missing', 'the last rows are missing'])
def test_a_jpeg_that_the_decoder_had_to_repair_is_refused(damaged, capfd):
    pytest.importorskip('simplejpeg')
    with pytest.raises(ImageError, match='damaged: Corrupt JPEG data: premature end'):
        read(damaged)
    assert capfd.readouterr().err == ''


def test_bytes_too_many_are_damage_but_for_the_few_that_cameras_leave_behind():
    pytest.importorskip('simplejpeg')
    np.testing.assert_array_equal(read(JPEG[:-2] + bytes(5) + END), read(JPEG))
    with pytest.raises(ImageError, match='extraneous bytes'):
        read(JPEG[:-2] + bytes(50) + END)


def test_without_simplejpeg_opencv_decodes_the_same(monkeypatch):
    whole = read(JPEG)
    monkeypatch.setattr(jpeg, 'simplejpeg', None)
    np.testing.assert_allclose(read(JPEG + bytes(99)).astype(int), whole, atol=1)
    with pytest.raises(ImageError, match='truncated'):
        read(JPEG[:-40] + bytes(99))


def test_a_damaged_picture_of_a_map_or_mask_is_refused(tmp_path):
    pytest.importorskip('simplejpeg')
    path = tmp_path / 'mask.jpg'
    path.write_bytes(JPEG[:HALF] + JPEG[HALF + 60:])
    with pytest.raises(MapError, match=r'mask.jpg is damaged \(Corrupt JPEG data'):
        load_mask(path)
    path.write_bytes(JPEG[:HALF] + bytes(4096))
    with pytest.raises(MapError, match='is cut off'):
        load_mask(path)
    path.write_bytes(JPEG + bytes(4096))
    np.testing.assert_array_equal(load_mask(path), read(JPEG))


def test_no_file_descriptor_is_turned(monkeypatch):
    with monkeypatch.context() as patched:
        patched.setattr('os.dup2', lambda *_: sys.exit('a descriptor is turned'))
        assert read(JPEG).shape == PICTURE.shape


def test_a_map_that_was_cut_off_is_told_in_one_line(tmp_path, capfd):
    path = tmp_path / 'mask.pgm'
    path.write_bytes(cv2.imencode('.pgm', PICTURE)[1].tobytes()[:5000])
    with pytest.raises(MapError, match=r'mask\.pgm cannot be read; expected a whole'):
        load_mask(path)
    assert capfd.readouterr().err == ''
