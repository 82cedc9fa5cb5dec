# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""The mask file: what the camera always sees of its own vehicle is not looked at."""

from __future__ import annotations

import cv2
from message_samples import camera_info, image_message, initial_pose
import numpy as np
import pytest
from test_frontend import CALIBRATION, CAMERA, COVARIANCE, PARAMETERS, S

from gip_localizer.core.estimate import Status
from gip_localizer.core.pose import difference
from gip_localizer.errors import MapError
from gip_localizer.io.map_files import load_mask
from gip_localizer.session.frontend import Frontend


@pytest.fixture(scope='module')
def scene(road):
    pose = road.pose(0.1)
    return pose, road.frame(CAMERA, pose)


def localized(road, truth, pixels, mask_file='', calibration=CALIBRATION):
    frontend = Frontend(road.map, PARAMETERS.replace({'mask_file': str(mask_file)}))
    frontend.on_camera_info(camera_info(calibration))
    frontend.on_initial_pose(initial_pose(truth, COVARIANCE))
    return frontend.on_image(image_message(pixels, 'mono8', stamp_ns=S))


def with_bonnet(pixels):
    """Paint a striped bonnet over the lower part, and the mask that leaves it out."""
    rows, cols = pixels.shape
    mask = np.full((rows, cols), 255, np.uint8)
    mask[int(0.7 * rows) :, cols // 4 : 3 * cols // 4] = 0
    stripes = np.where(np.arange(cols) // 20 % 2, 230, 20).astype(np.uint8)
    painted = np.where(mask == 0, stripes, pixels)
    return painted.astype(np.uint8), mask


def test_what_is_masked_carries_no_weight(road, scene, tmp_path):
    truth, pixels = scene
    painted, mask = with_bonnet(pixels)
    cv2.imwrite(str(tmp_path / 'mask.png'), mask)
    estimate = localized(road, truth, painted, tmp_path / 'mask.png')
    assert estimate.status is Status.TRACKING
    assert np.hypot(*difference(estimate.pose, truth)[:2]) < 0.02
    seen = localized(road, truth, pixels)
    weight, whole = estimate.match.weight, seen.match.weight
    assert 0.05 < (weight == 0).mean() - (whole == 0).mean() < 0.5
    again = localized(road, truth, np.where(mask == 0, 0, pixels).astype(np.uint8),
                      tmp_path / 'mask.png')
    np.testing.assert_allclose(again.pose, estimate.pose, atol=2e-3)


def test_a_mask_of_another_size_is_named(road, scene, tmp_path):
    cv2.imwrite(str(tmp_path / 'small.png'), np.full((10, 20), 255, np.uint8))
    estimate = localized(road, *scene, tmp_path / 'small.png')
    assert estimate.status is Status.BAD_IMAGE
    assert not estimate.published
    assert 'mask_file is 20x10' in estimate.reason


@pytest.mark.parametrize('content', [b'', b'no picture', None])
def test_an_unreadable_mask_is_refused(tmp_path, content):
    path = tmp_path / 'mask.png'
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MapError, match='mask_file'):
        load_mask(path)


def test_a_mask_of_16_bits_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / 'deep.png'), np.zeros((4, 4), np.uint16))
    with pytest.raises(MapError, match='16 bits'):
        load_mask(tmp_path / 'deep.png')


def test_an_unusable_mask_is_called_a_mask(tmp_path):
    with pytest.raises(MapError, match=r'^mask_file .*none\.png does not exist$'):
        load_mask(tmp_path / 'none.png')


def test_a_mask_that_is_black_all_over_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / 'mask.png'), np.full((10, 20), 1, np.uint8))
    with pytest.raises(MapError, match='black all over'):
        load_mask(tmp_path / 'mask.png')
