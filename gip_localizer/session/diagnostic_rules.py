# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The statuses of `/diagnostics`, their rules and their figures, defined once.

The node's messages (`session.diagnostics`) and `docs/diagnostics.md` are made from them.

"""

from __future__ import annotations

from gip_localizer.core.estimate import Status
from gip_localizer.session.diagnostic_types import DiagnosticGroup, Rule, Severity

W, E = Severity.WARN, Severity.ERROR

CAMERA = DiagnosticGroup('camera', (
    Rule('NO_IMAGE_YET', W, 'no image has been received since the start'),
    Rule('CLOCK_STOPPED', W, 'use_sim_time is set, and /clock has not moved for '
         'diagnostics.camera_timeout', withheld=False),
    Rule('NO_IMAGE', E, 'no image has been received for diagnostics.camera_timeout'),
    Rule(Status.BAD_IMAGE, E, 'encoding, step, size or data of the image cannot be used'),
    Rule(Status.FROZEN_IMAGE, E, 'the pixels equal those of the previous frame although the '
         'vehicle moved: the camera is frozen'),
    Rule('REPEATED_IMAGES', W, 'four or more frames have the same pixels, and no motion of the '
         'vehicle is known', withheld=False),
    Rule('FEW_BITS', W, '16 bit images use only their lower 8, 10, 12 or 14 bits; they are scaled '
         'to the bits in use', withheld=False),
    Rule(Status.NO_MASK, E, 'mask.required is set, and the image has no usable mask'),
    Rule('MASK_MISSING', W, 'mask.from_topic is set, and no mask with the stamp of the image '
         'arrived within mask.timeout; unless mask.required, it is localized without a mask',
         withheld=False),
    Rule('MASK_REFUSED', W, 'size, encoding or data of the mask cannot be used; unless '
         'mask.required, the image is localized without a mask',
         withheld=False),
    Rule(Status.OUT_OF_ORDER, W, 'a frame is not newer than the one before it, or over a minute '
         'ahead of it; it is skipped; if the next frame continues from it, the time jump '
         'is accepted'),
    Rule('TIME_WENT_BACK', W, 'the clock, or a stamp by over a second, went back in the last '
         '10 s (a bag in a loop); belief and odometry are reset when the next frame '
         'continues from it',
         withheld=False),
    Rule('FUTURE_STAMPS', W, 'a stamp is ahead of the clock by more than '
         'diagnostics.max_ahead', withheld=False),
    Rule('LATE_FRAMES', W, 'a stamp is behind the clock by more than diagnostics.max_delay',
         withheld=False),
), {
    'frames': ('', 'images received'),
    'image_age': ('s', 'time since the last image'),
    'image_delay': ('s', 'clock minus stamp at the arrival of the last image'),
    'image_rate': ('1/s', 'rate of the camera by its stamps; dropped images do not lower it'),
    'images_refused': ('', 'images that could not be used'),
    'masks': ('', 'images whose mask arrived'),
    'masks_refused': ('', 'images without a usable mask, where one is required'),
    'images_overtaken': ('', 'images dropped because a newer one had its mask first'),
})  # fmt: skip

CALIBRATION = DiagnosticGroup('calibration', (
    Rule(Status.NO_CALIBRATION, E, 'no usable camera_info has been received, or its size differs '
         'from the size of the image'),
    Rule(Status.NO_ROAD_IN_VIEW, E, 'camera_info and camera.* see no road inside birdseye.*'),
    Rule('NO_CAMERA_INFO_YET', W, 'no camera_info has been received since the start'),
    Rule('CAMERA_INFO_REFUSED', W, 'the last camera_info cannot be used; the previous one is kept',
         withheld=False),
    Rule('LENS_UNNAMED', W, 'distortion_model of camera_info is empty; D is used as the one model '
         'that takes as many numbers', withheld=False),
    Rule('VIEW_OUTSIDE_IMAGE', W, 'more than half of the cells of a given birdseye.* lie outside '
         'the image', withheld=False),
    Rule('VIEW_BUILDING', W, 'the view is computed for a new calibration, map or parameter; poses '
         'follow when it is done', withheld=False),
    Rule('VIEW_CELLS', W, 'the given birdseye.resolution is below half, or above four times, the '
         'side of a map cell', withheld=False),
    Rule('RECTIFIED_DIFFERS', W, 'the name of the image topic suggests rectified images and '
         'camera.rectified is false, or the reverse', withheld=False),
    Rule('NO_CAMERA_TF', E, 'camera.from_tf is set, and the transform is unknown'),
), {
    'camera_infos': ('', 'messages received'),
    'camera_infos_refused': ('', 'messages that could not be used'),
})  # fmt: skip

MAP = DiagnosticGroup('map', (
    Rule(Status.OFF_MAP, E, 'no place in the search window lies on the map'),
    Rule(Status.LOW_OVERLAP, E, 'less than score.min_overlap of the view lies on known map cells'),
), {
    'map_cells': ('', 'columns x rows'),
    'map_resolution': ('m', 'side of a cell'),
    'map_hash': ('', 'hash of the picture, its resolution and origin'),
})  # fmt: skip

PRIOR = DiagnosticGroup('prior', (
    Rule(Status.NO_PRIOR, W, 'no initialpose, initial_pose.* or relocalize so far'),
    Rule('INITIALPOSE_REFUSED', W, 'the last initialpose is of another frame, not finite or off '
         'the map (until a usable one comes, for 10 s at least); the belief stays',
         withheld=False),
    Rule('STATE_REFUSED', W, 'state_file is of another map, too old or damaged (reported for '
         '10 s)',
         withheld=False),
), {
    'prediction': ('', 'source of the motion from the last pose to this frame'),
    'initialposes': ('', 'messages received'),
    'initialposes_refused': ('', 'messages that could not be used'),
})  # fmt: skip

ODOMETRY = DiagnosticGroup('odometry', (
    Rule('ODOMETRY_REFUSED', W, 'a message jumps, repeats a stamp, goes back or jumps in time, '
         'holds NaN, or is not of frames.odom and frames.base (reported for 10 s)',
         withheld=False),
    Rule('ODOMETRY_OFF_TIME', W, 'no message is stamped within motion.max_gap of the image; the '
         'last velocity is used', withheld=False),
    Rule('ODOMETRY_CONTRADICTED', W, 'odometry disagrees with the motion of the matches (it is '
         'stopped, of another vehicle or in other units); the velocity of the matches is used '
         'until both agree again', withheld=False),
    Rule('ODOMETRY_STALE', W, 'no message for diagnostics.odometry_timeout; the last velocity '
         'is used', withheld=False),
), {
    'odometries': ('', 'messages received'),
    'odometries_refused': ('', 'messages that could not be used'),
    'odometry_age': ('s', 'time since the last message'),
})  # fmt: skip

MATCH = DiagnosticGroup('match', (
    Rule(Status.LOW_CONTRAST, E, 'the view is flat, dark or saturated (below '
         'integrity.min_contrast), or masked altogether'),
    Rule(Status.NO_MATCH, E, 'the confidence is below integrity.min_confidence (or '
         'min_confidence_tracking where earlier poses expect the match), the refinement did not '
         'converge, the match lies outside the window, or other places match nearly as well'),
    Rule(Status.AMBIGUOUS, E, 'another place matches the view nearly as well: the confidence '
         'is therefore below integrity.min_confidence'),
    Rule(Status.UNCERTAIN, E, 'the covariance exceeds integrity.max_sigma_xy or max_sigma_yaw'),
    Rule(Status.CONFIRMING, W, 'a pose found on the whole map waits for recovery.confirm_frames'),
    Rule(Status.LOST, E, 'integrity.lost_after frames in a row without a fix'),
    Rule(Status.FAULT, E, 'unexpected exception while processing the frame; its traceback is in '
         'the log'),
    Rule('SEARCHING', W, 'the whole map is searched for a frame; newer frames wait'),
    Rule('SLOW', W, 'the median execution time exceeds the time between images',
         withheld=False),
), {
    'confidence': ('', 'probability that the match is at the right place'),
    'margin': ('', 'fit score of the match, less the share that the best other place reaches'),
    'competitor': ('', 'likeness of the best match at another place; 1 is equal'),
    'significance': ('', 'lattice_correlation in standard deviations of chance correlation'),
    'correlation': ('', 'correlation of view and map under the Gramian, at the match'),
    'lattice_correlation': ('', 'the same before refinement, camera at rest'),
    'contrast': ('', 'weighted standard deviation of the view, grey levels of [0, 1]'),
    'overlap': ('', 'share of the view on known map cells'),
    'agreement': ('', 'share of the road that agrees with the map'),
    'inliers': ('', 'share of the cells that agree with the map'),
    'overdispersion': ('', 'standard deviation of residuals over that of the noise; 1: equal'),
    'chi_sq': ('', 'mean weighted squared residual over its expectation; 1: equal'),
    'winner_mass': ('', 'share of the posterior in the winning mode'),
    'second_ratio': ('', 'least residual elsewhere in the window over that of the best match'),
    'entropy': ('nat', 'entropy of the posterior over the window'),
    'sigma_ahead_m': ('m', 'standard deviation of the match along the vehicle'),
    'sigma_left_m': ('m', 'standard deviation across the vehicle'),
    'sigma_yaw_rad': ('rad', 'standard deviation of the heading'),
    'sigma_cells': ('', 'standard deviation of the position in cells'),
    'suspension': ('', 'motion of the camera from its calibrated pose, in standard deviations'),
    'gain': ('', 'contrast of the image over that of the map'),
    'pitch_rad': ('rad', 'pitch of the camera relative to its calibration'),
    'roll_rad': ('rad', 'roll relative to its calibration'),
    'height_m': ('m', 'height relative to its calibration'),
    'execution_time_p50_ms': ('ms', 'median over 100 frames'),
    'execution_time_p95_ms': ('ms', '95th percentile'),
    'calibrate_ms': ('ms', 'precomputing for a new calibration or view, last frame'),
    'birdseye_ms': ('ms', 'rectification, last frame'),
    'gramian_ms': ('ms', 'weights, last frame'),
    'match_ms': ('ms', 'scores and refinement, last frame'),
    'posterior_ms': ('ms', 'verdict and filter, last frame'),
})  # fmt: skip

OUTPUT = DiagnosticGroup('output', (
    Rule('DISABLED', W, 'images are ignored: switched off by ~/enable, or the node is not active'),
    Rule('WAITING', W, 'no frame has been localized yet'),
    Rule('WITHHELD', E, 'the last frame gave no pose; the message names the status with '
         'the reason'),
    Rule('ALERT_LIMIT', W, 'the protection level of the last pose exceeds integrity.alert_ahead, '
         'alert_left or alert_yaw', withheld=False),
    Rule('NO_TF', W, 'tf.publish is set, and there was no odometry at the image, or no pose for '
         'tf.hold; poses are published', withheld=False),
    Rule('TF_CONTESTED', W, 'another node publishes the transform from frames.map to frames.odom '
         '(reported for 10 s)', withheld=False),
    Rule('DUPLICATE_NAME', W, 'another node has the same name: parameters and services reach '
         'either', withheld=False),
), {
    'published': ('', 'published poses'),
    'availability': ('', 'share of the frames that gave a pose'),
    'pose_age': ('s', 'time since the last published pose'),
    'protection_ahead_m': ('m', 'error along the vehicle that is exceeded with integrity.risk'),
    'protection_left_m': ('m', 'the same across the vehicle'),
    'protection_yaw_rad': ('rad', 'the same in heading'),
    'protection_valid': ('', '1: the protection level meets integrity.alert_*; 0: it does not'),
})  # fmt: skip

DIAGNOSTIC_GROUPS = (CAMERA, CALIBRATION, MAP, PRIOR, ODOMETRY, MATCH, OUTPUT)
"""All groups, in the order of the processing."""


def rule_of(name: str) -> tuple[DiagnosticGroup, Rule] | None:
    """Return a rule by its name, with its group; None if no rule has this name."""
    for group in DIAGNOSTIC_GROUPS:
        for rule in group.rules:
            if rule.name == name:
                return group, rule
    return None
