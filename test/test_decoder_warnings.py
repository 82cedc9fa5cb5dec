# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What the JPEG decoder mends in silence is told and refused; what does no harm is taken."""

from __future__ import annotations

import os
import subprocess
import sys

import cv2
from message_samples import compressed_message
import numpy as np
import pytest

from gip_localizer.errors import ImageError, MapError
from gip_localizer.io.images import compressed_grey_image
from gip_localizer.io.jpeg_warnings import damage, decoder_warnings
from gip_localizer.io.map_files import load_mask

NOISE = np.random.default_rng(1).integers(0, 255, (120, 160)).astype(np.uint8)
PICTURE = cv2.GaussianBlur(NOISE, (0, 0), 2.0)
JPEG = cv2.imencode('.jpg', PICTURE)[1].tobytes()
HALF = len(JPEG) // 2
END = b'\xff\xd9'


def read(content):
    return compressed_grey_image(compressed_message(content))


@pytest.mark.parametrize('damaged', [
    JPEG[:HALF] + JPEG[HALF + 60:], JPEG[:HALF] + END, JPEG[:-40] + END,
], ids=['a piece is missing', 'half is missing', 'the last rows are missing'])
def test_a_jpeg_that_the_decoder_had_to_mend_is_refused(damaged, capfd):
    assert cv2.imdecode(np.frombuffer(damaged, np.uint8), 0) is not None
    capfd.readouterr()
    with pytest.raises(ImageError, match='damaged: Corrupt JPEG data: premature end'):
        read(damaged)
    assert capfd.readouterr().err == ''


def test_bytes_too_many_are_damage_but_for_the_few_that_cameras_leave_behind():
    np.testing.assert_array_equal(read(JPEG[:-2] + bytes(5) + END), read(JPEG))
    with pytest.raises(ImageError, match='extraneous bytes'):
        read(JPEG[:-2] + bytes(50) + END)


def test_whole_pictures_are_taken_at_every_quality_and_sampling():
    colour = np.dstack([PICTURE, PICTURE[::-1], PICTURE[:, ::-1]])
    for pixels in (PICTURE, colour):
        for flags in ([cv2.IMWRITE_JPEG_QUALITY, 5], [cv2.IMWRITE_JPEG_QUALITY, 100],
                      [cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 4]):
            assert read(cv2.imencode('.jpg', pixels, flags)[1].tobytes()).shape == PICTURE.shape


def test_a_damaged_picture_of_a_map_or_mask_is_refused(tmp_path):
    path = tmp_path / 'mask.jpg'
    path.write_bytes(JPEG[:HALF] + JPEG[HALF + 60:])
    with pytest.raises(MapError, match=r'mask.jpg is damaged \(Corrupt JPEG data'):
        load_mask(path)


def test_what_others_write_meanwhile_is_passed_on(capfd):
    with decoder_warnings() as warnings:
        os.write(2, b'[INFO] all is well\nCorrupt JPEG data: bad Huffman code\nbye\n')
    assert warnings == ['Corrupt JPEG data: bad Huffman code']
    assert capfd.readouterr().err == '[INFO] all is well\nbye\n'


def test_an_error_leaves_standard_error_as_it_was(capfd):
    with pytest.raises(KeyError), decoder_warnings():
        raise KeyError
    os.write(2, b'still here\n')
    assert capfd.readouterr().err == 'still here\n'


def test_warnings_that_tell_of_no_damage():
    assert damage(['Warning: unknown JFIF revision number 9.01',
                   'libpng warning: iCCP: known incorrect sRGB profile',
                   'Corrupt JPEG data: 8 extraneous bytes before marker 0xd6']) == ''


def test_without_a_standard_error_pictures_are_still_read():
    code = (
        'import os, numpy as np, cv2; from gip_localizer.io.images import _decoded; os.close(2); '
        "pixels, damaged = _decoded(cv2.imencode('.jpg', np.zeros((8, 8), np.uint8))[1].ravel()); "
        "print(pixels.shape, repr(damaged))"
    )
    done = subprocess.run([sys.executable, '-c', code], stdout=subprocess.PIPE, text=True,
                          check=True)
    assert done.stdout.strip() == "(8, 8) ''"


def test_a_map_that_was_cut_off_is_told_in_one_line(tmp_path, capfd):
    path = tmp_path / 'mask.pgm'
    path.write_bytes(cv2.imencode('.pgm', PICTURE)[1].tobytes()[:5000])
    with pytest.raises(MapError, match=r'mask\.pgm cannot be read; expected a whole'):
        load_mask(path)
    assert capfd.readouterr().err == ''
