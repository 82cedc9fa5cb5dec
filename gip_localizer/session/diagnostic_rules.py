# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
What can be the matter, once: the statuses of `/diagnostics`, their rules and their figures.

From here come the node's messages (`gip_localizer.session.diagnostics`) and the README's table.

"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

from gip_localizer.core.estimate import Status


class Severity(IntEnum):
    """Of a diagnostic status; the numbers are those of diagnostic_msgs."""

    OK = 0
    WARN = 1
    ERROR = 2


@dataclass(frozen=True)
class Rule:
    """
    One thing that can be the matter.

    Attributes
    ----------
    name : str
        The word with which the message begins.
    level : Severity
        How bad it is.
    when : str
        The condition, in words.
    withheld : bool
        True: no pose is published meanwhile.

    """

    name: str
    level: Severity
    when: str
    withheld: bool = True


@dataclass(frozen=True)
class DiagnosticGroup:
    """
    One diagnostic status.

    Attributes
    ----------
    name : str
        As in `<node>: <name>`.
    rules : tuple of Rule
        All that it may say besides OK, in the order in which those that hold are said.
    figures : dict
        Key → unit and meaning; an empty unit is a plain number.

    """

    name: str
    rules: tuple[Rule, ...]
    figures: dict[str, tuple[str, str]]


W, E = Severity.WARN, Severity.ERROR

CAMERA = DiagnosticGroup('camera', (
    Rule('NO_IMAGE_YET', W, 'no image has come since the start'),
    Rule('CLOCK_STOPPED', W, 'use_sim_time is set, and /clock has not moved for '
         'diagnostics.camera_timeout', withheld=False),
    Rule('NO_IMAGE', E, 'no image has come for diagnostics.camera_timeout'),
    Rule(Status.BAD_IMAGE, E, 'encoding, step, size or data of the image cannot be used'),
    Rule(Status.FROZEN_IMAGE, E, 'pixels repeat those of the frame before, while the motion says '
         'that the vehicle moved: the camera is frozen'),
    Rule('REPEATED_IMAGES', W, 'four frames or more with the same pixels, and nothing says that '
         'the vehicle moved', withheld=False),
    Rule('FEW_BITS', W, '16 bit images use only their lower 8, 10, 12 or 14 bits; they are scaled '
         'by what is used', withheld=False),
    Rule(Status.NO_MASK, E, 'mask.required is set, and the image has no usable mask'),
    Rule('MASK_MISSING', W, 'mask.from_topic is set, and no mask of the stamp of the image came '
         'within mask.timeout; without mask.required it is localized without one',
         withheld=False),
    Rule('MASK_REFUSED', W, 'size, encoding or data of the mask cannot be used; the same holds',
         withheld=False),
    Rule(Status.OUT_OF_ORDER, W, 'a frame is not newer than the one before it, or over a minute '
         'ahead of it; it is skipped, and where the next one follows it, time itself has leapt'),
    Rule('TIME_WENT_BACK', W, 'the clock, or a stamp by over a second, went back in the last '
         '10 s (a bag in a loop); where the next frame follows, belief and odometry begin anew',
         withheld=False),
    Rule('FUTURE_STAMPS', W, 'a stamp lies ahead of the clock by more than '
         'diagnostics.max_ahead', withheld=False),
    Rule('LATE_FRAMES', W, 'a stamp lies behind the clock by more than diagnostics.max_delay',
         withheld=False),
), {
    'frames': ('', 'images that came'),
    'image_age': ('s', 'since the last image came'),
    'image_delay': ('s', 'clock minus stamp when the last image came'),
    'image_rate': ('1/s', 'images per second of their stamps'),
    'images_refused': ('', 'that could not be used'),
    'masks': ('', 'images whose mask came'),
    'masks_refused': ('', 'images without a usable mask, where one is asked for'),
    'images_overtaken': ('', 'that a newer image with its mask overtook'),
})  # fmt: skip

CALIBRATION = DiagnosticGroup('calibration', (
    Rule(Status.NO_CALIBRATION, E, 'no usable camera_info has come, or the image has another '
         'size than it says'),
    Rule(Status.NO_ROAD_IN_VIEW, E, 'camera_info and camera.* see no road inside birdseye.*'),
    Rule('NO_CAMERA_INFO_YET', W, 'no camera_info has come since the start'),
    Rule('CAMERA_INFO_REFUSED', W, 'the last camera_info cannot be used; the one before holds',
         withheld=False),
    Rule('RECTIFIED_DIFFERS', W, 'the name of the image topic says rectified and camera.rectified '
         'does not, or the reverse', withheld=False),
    Rule('NO_CAMERA_TF', E, 'camera.from_tf is set, and the transform is not known'),
), {
    'camera_infos': ('', 'messages that came'),
    'camera_infos_refused': ('', 'that could not be used'),
})  # fmt: skip

MAP = DiagnosticGroup('map', (
    Rule(Status.OFF_MAP, E, 'no place that was looked at lies on the map'),
    Rule(Status.LOW_OVERLAP, E, 'less than score.min_overlap of the view lies on known map cells'),
), {
    'map_cells': ('', 'columns x rows'),
    'map_resolution': ('m', 'side of a cell'),
    'map_hash': ('', 'of the picture, its resolution and origin'),
})  # fmt: skip

PRIOR = DiagnosticGroup('prior', (
    Rule(Status.NO_PRIOR, W, 'no initialpose, initial_pose.* or relocalize so far'),
    Rule('INITIALPOSE_REFUSED', W, 'the last initialpose is of another frame, not finite or off '
         'the map (until a usable one comes, for 10 s at least); the belief stays',
         withheld=False),
    Rule('STATE_REFUSED', W, 'state_file is of another map, too old or damaged (told for 10 s)',
         withheld=False),
), {
    'prediction': ('', 'what moved the last pose to this frame'),
    'initialposes': ('', 'messages that came'),
    'initialposes_refused': ('', 'that could not be used'),
})  # fmt: skip

ODOMETRY = DiagnosticGroup('odometry', (
    Rule('ODOMETRY_REFUSED', W, 'it jumps, repeats a stamp, goes back or leaps in time, holds NaN '
         'or is of another frame than frames.odom and frames.base (told for 10 s)',
         withheld=False),
    Rule('ODOMETRY_OFF_TIME', W, 'none is stamped within motion.max_gap of the image; the last '
         'velocity is held', withheld=False),
    Rule('ODOMETRY_CONTRADICTED', W, 'the matches moved otherwise than odometry tells (it stands '
         'still, is of another vehicle or in other units); the velocity of the matches is held '
         'until both agree again', withheld=False),
    Rule('ODOMETRY_STALE', W, 'none has come for diagnostics.odometry_timeout; the last velocity '
         'is held', withheld=False),
), {
    'odometries': ('', 'messages that came'),
    'odometries_refused': ('', 'that could not be used'),
    'odometry_age': ('s', 'since the last one came'),
})  # fmt: skip

MATCH = DiagnosticGroup('match', (
    Rule(Status.LOW_CONTRAST, E, 'the view is flat, dark or saturated (below '
         'integrity.min_contrast), or masked altogether'),
    Rule(Status.NO_MATCH, E, 'the map does not explain the view: below '
         'integrity.min_confidence'),
    Rule(Status.AMBIGUOUS, E, 'another place explains the view nearly as well: below '
         'integrity.min_confidence because of it'),
    Rule(Status.UNCERTAIN, E, 'the covariance exceeds integrity.max_sigma_xy or max_sigma_yaw'),
    Rule(Status.CONFIRMING, W, 'a pose found anew waits for recovery.confirm_frames'),
    Rule(Status.LOST, E, 'integrity.lost_after frames in a row without a fix'),
    Rule(Status.FAULT, E, 'the frame raised an error that nobody foresaw; its traceback is in the '
         'log'),
    Rule('SEARCHING', W, 'the whole map is searched for a frame, and the frames meanwhile wait'),
    Rule('SLOW', W, 'the median execution time exceeds the time between images',
         withheld=False),
), {
    'confidence': ('', 'probability that the match is at the right place'),
    'margin': ('', 'how far the match is ahead of the best one at another place'),
    'competitor': ('', 'likeness of the best match at another place; 1 is equal'),
    'significance': ('', 'lattice_correlation in standard deviations of chance correlation'),
    'correlation': ('', 'of view and map under the Gramian, at the match'),
    'lattice_correlation': ('', 'the same before refinement, camera at rest'),
    'contrast': ('', 'weighted standard deviation of the view, grey levels of [0, 1]'),
    'overlap': ('', 'share of the view on known map cells'),
    'agreement': ('', 'share of the road that agrees with the map'),
    'inliers': ('', 'share of the cells that agree with the map'),
    'overdispersion': ('', 'residual beyond what noise explains; 1 is none'),
    'chi_sq': ('', 'mean weighted residual over its expected noise; honest is 1'),
    'winner_mass': ('', 'share of the posterior in the winning mode'),
    'second_ratio': ('', 'least residual elsewhere in the window over that of the best match'),
    'entropy': ('nat', 'of the posterior over the window'),
    'sigma_ahead_m': ('m', 'standard deviation of the match along the vehicle'),
    'sigma_left_m': ('m', 'across it'),
    'sigma_yaw_rad': ('rad', 'in heading'),
    'sigma_cells': ('', 'standard deviation of the position in cells'),
    'suspension': ('', 'motion of the camera beside its calibration, in standard deviations'),
    'gain': ('', 'contrast of the image over that of the map'),
    'pitch_rad': ('rad', 'pitch of the camera beside its calibration'),
    'roll_rad': ('rad', 'roll beside its calibration'),
    'height_m': ('m', 'height beside its calibration'),
    'execution_time_p50_ms': ('ms', 'median over 100 frames'),
    'execution_time_p95_ms': ('ms', '95th percentile'),
    'calibrate_ms': ('ms', 'precomputing for a new calibration or view, last frame'),
    'birdseye_ms': ('ms', 'rectification, last frame'),
    'gramian_ms': ('ms', 'weights, last frame'),
    'match_ms': ('ms', 'scores and refinement, last frame'),
    'posterior_ms': ('ms', 'verdict and filter, last frame'),
})  # fmt: skip

OUTPUT = DiagnosticGroup('output', (
    Rule('DISABLED', W, 'by the service ~/enable, or the node is not active'),
    Rule('WAITING', W, 'no frame has been localized yet'),
    Rule('WITHHELD', E, 'the last frame gave no pose; the message names the status that tells '
         'why'),
    Rule('NO_TF', W, 'tf.publish is set, and there was no odometry at the image, or no pose for '
         'tf.hold; poses are published', withheld=False),
    Rule('TF_CONTESTED', W, 'another node publishes the transform from frames.map to frames.odom '
         '(said for 10 s)', withheld=False),
    Rule('DUPLICATE_NAME', W, 'another node has the same name: parameters and services reach '
         'either', withheld=False),
), {
    'published': ('', 'poses that went out'),
    'availability': ('', 'share of the frames that gave a pose'),
    'pose_age': ('s', 'since the last pose went out'),
})  # fmt: skip

DIAGNOSTIC_GROUPS = (CAMERA, CALIBRATION, MAP, PRIOR, ODOMETRY, MATCH, OUTPUT)
"""In the order of the flow."""


def rule_of(name: str) -> tuple[DiagnosticGroup, Rule] | None:
    """Return a rule by its name, with its group; None for what is no matter at all."""
    for group in DIAGNOSTIC_GROUPS:
        for rule in group.rules:
            if rule.name == name:
                return group, rule
    return None


def diagnostics_table() -> str:
    """Return all rules, then all figures, as Markdown."""
    rows = ['| status | message | level | when | pose |', '| --- | --- | --- | --- | --- |']
    rows += [
        f'| {group.name} | `{rule.name}` | {rule.level.name} | {rule.when} '
        f'| {"withheld" if rule.withheld else "published"} |'
        for group in DIAGNOSTIC_GROUPS for rule in group.rules
    ]  # fmt: skip
    rows += ['', '| status | key | unit | meaning |', '| --- | --- | --- | --- |']
    rows += [
        f'| {group.name} | `{key}` | {unit} | {meaning} |'
        for group in DIAGNOSTIC_GROUPS for key, (unit, meaning) in group.figures.items()
    ]  # fmt: skip
    return '\n'.join(rows)
