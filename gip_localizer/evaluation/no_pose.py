# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What to try when a replay gives no pose, in options of `gip replay` instead of services."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from gip_localizer.core.estimate import Status
from gip_localizer.evaluation.metrics import status_word
from gip_localizer.evaluation.run import FrameResult

START = (
    'give a start with --initial-pose X,Y,YAW (or the word truth), or search the map with '
    '--relocalize'
)
MATCH = (
    'check in this order: the start (--initial-pose, or --relocalize to search the map), the pose '
    'of the camera (gip check-calibration; --set camera.pitch=...), the view (--set '
    'birdseye.near=... and birdseye.far=...; it must lie inside the image), the map (--map)'
)
PLACE = 'the start is not on the map: check --initial-pose and --map, or search with --relocalize'
IMAGES = 'choose another image topic with --image-topic, and see the reason in frames.csv'
ADVICE = {
    Status.NO_PRIOR: START,
    Status.OFF_MAP: PLACE,
    Status.LOW_OVERLAP: PLACE,
    Status.NO_CALIBRATION: 'choose another camera_info with --camera-info-topic',
    Status.NO_ROAD_IN_VIEW: 'correct --set camera.z, camera.pitch, birdseye.near, birdseye.far',
    Status.BAD_IMAGE: IMAGES,
    Status.FROZEN_IMAGE: IMAGES,
    Status.LOW_CONTRAST: 'check mask_file and the view (--set birdseye.near, birdseye.far)',
    Status.NO_MASK: 'name the masks with --mask-topic, or --set mask.required=false',
    Status.OUT_OF_ORDER: 'the stamps of the images go back; correct them, or choose another topic',
    Status.CONFIRMING: 'too few frames agreed: replay more of the bag, or --set '
                       'recovery.confirm_frames=1',
    Status.FAULT: 'an unexpected exception; please report its traceback',
}
"""Remedies by status; for all others `MATCH`."""


def desk_reason(estimate: FrameResult) -> str:
    """Return the reason of a withheld frame, with options of the desk tool where it has them."""
    if status_word(estimate) == Status.NO_PRIOR.value:
        return f'no prior yet: {START}'
    return estimate.reason


def no_pose_advice(estimates: Sequence[FrameResult]) -> str:
    """Return what to try if there were frames but no pose, in one sentence; '' otherwise."""
    if not estimates or any(estimate.pose is not None for estimate in estimates):
        return ''
    words = Counter(status_word(estimate) for estimate in estimates)
    causes = [word for word, _ in words.most_common() if word != Status.LOST.value]
    cause = causes[0] if causes else Status.LOST.value
    known = {status.value: advice for status, advice in ADVICE.items()}
    counted = ', '.join(f'{word} in {count}' for word, count in words.most_common())
    return (
        f'no frame gave a pose ({counted} of {len(estimates)} frames): '
        f'{known.get(cause, MATCH)}'
    )
