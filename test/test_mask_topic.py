# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Masks that come as messages: paired by stamp, combined with the file, refused by name."""

from __future__ import annotations

import cv2
from hypothesis import given
from hypothesis import strategies as st
from message_samples import camera_info, image_message, initial_pose
import numpy as np
import pytest
from test_frontend import CALIBRATION, CAMERA, COVARIANCE, PARAMETERS, S
from test_mask import with_bonnet

from gip_localizer.core.estimate import Status
from gip_localizer.core.pose import difference
from gip_localizer.io.messages import stamp_ns
from gip_localizer.parameters.integration import MaskTopic
from gip_localizer.session.frontend import Frontend
from gip_localizer.session.mask_sync import Masked, MaskPairing, MOST_WAITING

MS = 1_000_000
TINY = np.zeros((2, 2), np.uint8)


def tiny(stamp_ms):
    return image_message(TINY, 'mono8', stamp_ns=stamp_ms * MS)


def pairing(**limits):
    return MaskPairing(lambda: MaskTopic(from_topic=True, **limits))


def stamps(masked):
    """Stamps (ms) of image and mask; None where there is none."""
    if masked is None:
        return None
    mask = None if masked.mask is None else stamp_ns(masked.mask.header) // MS
    return stamp_ns(masked.image.header) // MS, mask


@pytest.mark.parametrize('mask_first', [False, True])
def test_an_image_and_its_mask_meet_in_either_order(mask_first):
    pairs = pairing()
    adds = [lambda: pairs.add_image(tiny(100), 0), lambda: pairs.add_mask(tiny(100))]
    first, second = reversed(adds) if mask_first else adds
    assert first() is None
    assert stamps(second()) == (100, 100)
    assert pairs.overdue(S) == []


def test_stamps_must_be_the_same_or_within_the_tolerance():
    exact = pairing()
    exact.add_image(tiny(100), 0)
    assert exact.add_mask(tiny(101)) is None
    slack = pairing(tolerance=0.005)
    slack.add_image(tiny(100), 0)
    assert slack.add_mask(tiny(106)) is None
    assert stamps(slack.add_mask(tiny(95))) == (100, 95)


def test_of_several_masks_within_the_tolerance_the_nearest_is_taken():
    pairs = pairing(tolerance=0.01)
    for stamp in (92, 99, 107):
        pairs.add_mask(tiny(stamp))
    assert stamps(pairs.add_image(tiny(100), 0)) == (100, 99)


def test_a_network_slower_than_the_camera_sets_the_pace():
    pairs = pairing()
    for stamp in (100, 133, 167):
        assert pairs.add_image(tiny(stamp), stamp * MS) is None
    assert stamps(pairs.add_mask(tiny(133))) == (133, 133)
    assert pairs.dropped == 1
    assert [stamps(m) for m in pairs.overdue(S)] == [(167, None)]


def test_an_image_waits_no_longer_than_the_timeout_and_tells_why():
    pairs = pairing(timeout=0.05)
    pairs.add_image(tiny(100), 0)
    assert pairs.overdue(49 * MS) == []
    [masked] = pairs.overdue(50 * MS)
    assert 'no mask has been received' in masked.missing
    pairs.add_mask(tiny(3100))
    pairs.add_image(tiny(200), 100 * MS)
    [masked] = pairs.overdue(200 * MS)
    assert 'stamped 2.9 s ahead of the image' in masked.missing


def test_a_bag_in_a_loop_leaves_nothing_waiting_of_the_time_before():
    pairs = pairing()
    pairs.add_image(tiny(90_000), 0)
    pairs.add_image(tiny(100), 0)
    assert stamps(pairs.add_mask(tiny(100))) == (100, 100)
    assert pairs.flush() == []


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 60)), max_size=80))
def test_memory_is_bounded_and_no_image_comes_out_twice(steps):
    pairs, out, messages = pairing(tolerance=0.001), [], []
    for now, (is_image, stamp) in enumerate(steps):
        message = tiny(stamp)
        messages.append(message)
        found = pairs.add_image(message, now * MS) if is_image else pairs.add_mask(message)
        out += [id(found.image)] if found else []
        out += [id(m.image) for m in pairs.overdue(now * MS)]
    left = pairs.flush()
    assert len(left) <= MOST_WAITING
    out += [id(m.image) for m in left]
    assert len(out) == len(set(out))
    assert len(out) + pairs.dropped == sum(is_image for is_image, _ in steps)


def test_of_masks_without_an_image_the_newest_are_kept():
    pairs, stamps_ms = pairing(), range(100, 101 + MOST_WAITING)
    for stamp in stamps_ms:
        assert pairs.add_mask(tiny(stamp)) is None
    assert pairs.add_image(tiny(stamps_ms[0]), 0) is None
    assert stamps(pairs.add_image(tiny(stamps_ms[1]), 0)) == (stamps_ms[1], stamps_ms[1])


@pytest.fixture(scope='module')
def scene(road):
    pose = road.pose(0.1)
    painted, mask = with_bonnet(road.frame(CAMERA, pose))
    return pose, painted, mask


def localized(road, scene, mask, missing='', **changes):
    settings = {key.replace('__', '.'): value for key, value in changes.items()}
    frontend = Frontend(road.map, PARAMETERS.replace({'mask.from_topic': True, **settings}))
    frontend.on_camera_info(camera_info(CALIBRATION))
    frontend.on_initial_pose(initial_pose(scene[0], COVARIANCE))
    image = image_message(scene[1], 'mono8', stamp_ns=S)
    return frontend, frontend.on_image(image, Masked(image, mask, missing))


def message(mask, encoding='mono8', **changes):
    made = image_message(mask, encoding, stamp_ns=S)
    for name, value in changes.items():
        setattr(made, name, value)
    return made


def assert_right(estimate, truth):
    assert estimate.status is Status.TRACKING, estimate.reason
    assert np.hypot(*difference(estimate.pose, truth)[:2]) < 0.02


@pytest.mark.parametrize('encoding', ['mono8', '8UC1'])
def test_what_a_mask_message_hides_carries_no_weight(road, scene, encoding):
    truth, _, mask = scene
    frontend, estimate = localized(road, scene, message(mask, encoding))
    assert_right(estimate, truth)
    assert not frontend.warnings
    _, unmasked = localized(road, scene, None, 'none came')
    assert (estimate.match.weight == 0).sum() > (unmasked.match.weight == 0).sum() + 100


def test_file_and_message_hide_together(road, scene, tmp_path):
    truth, _, mask = scene
    left, right = mask.copy(), mask.copy()
    middle = mask.shape[1] // 2
    left[:, middle:], right[:, :middle] = 255, 255
    cv2.imwrite(str(tmp_path / 'mask.png'), left)
    file = str(tmp_path / 'mask.png')
    _, together = localized(road, scene, message(right), mask_file=file)
    _, whole = localized(road, scene, message(mask))
    assert_right(together, truth)
    np.testing.assert_array_equal(together.match.weight == 0, whole.match.weight == 0)


def bad_masks(mask):
    return {
        'mask is 4x4, the image': message(np.full((4, 4), 255, np.uint8)),
        "mask encoding 'bgr8'": message(
            np.dstack([mask] * 3).reshape(len(mask), -1), 'bgr8', width=mask.shape[1]),
        "mask encoding '32FC1'": message(mask, '32FC1'),
        'largest value of the mask is 7': message(np.minimum(mask, 7)),
        'holds 10 bytes': message(mask, data=np.zeros(10, np.uint8)),
    }


@pytest.mark.parametrize('word', bad_masks(np.zeros((2, 2), np.uint8)))
@pytest.mark.parametrize('required', [False, True])
def test_a_bad_mask_is_named_and_the_estimate_unharmed(road, scene, word, required):
    frontend, estimate = localized(road, scene, bad_masks(scene[2])[word],
                                   mask__required=required)
    assert word in frontend.warnings['MASK_REFUSED']
    assert frontend.counts['mask_refused'] == 1
    if required:
        assert estimate.status is Status.NO_MASK
        assert word in estimate.reason
        assert estimate.pose is None
    else:
        _, without = localized(road, scene, None)
        assert estimate.pose == without.pose
        assert estimate.pose is not None


@pytest.mark.parametrize('required', [False, True])
def test_a_missing_mask_is_named(road, scene, required):
    frontend, estimate = localized(road, scene, None, 'no mask within', mask__required=required)
    assert frontend.warnings == {'MASK_MISSING': 'no mask within'}
    assert (estimate.status is Status.NO_MASK) == required
    assert estimate.published != required


def test_a_mask_that_hides_all_leaves_nothing_to_match(road, scene):
    _, estimate = localized(road, scene, message(np.zeros_like(scene[2])))
    assert not estimate.published
    assert estimate.reason
