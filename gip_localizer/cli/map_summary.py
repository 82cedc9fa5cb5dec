# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""What `gip map` reports about a map and about the poses it was built with."""

from __future__ import annotations

import math

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import on_unit_scale
from gip_localizer.evaluation.metrics import TableRow
from gip_localizer.mapping.mapped_drive import MappedDrive
from gip_localizer.mapping.pose_check import LEAST_PAIRS, PoseCheckResult
from gip_localizer.mapping.pose_errors import PoseErrors
from gip_localizer.mapping.survey_camera import LONGEST_PIXEL

LEAST_DRIFT = 0.01
"""Disagreement per metre that is named, m/m; chosen: 1.5 cm of height at 1.5 m."""
MOST_NAMED = 5
"""Largest number of pairs of frames that are named; chosen."""


def range_note(drive: MappedDrive, resolution: float) -> list[str]:
    """Return a note if a part of the view is too coarse for the cells of the map."""
    used, seen = drive.camera.farthest
    if seen - used < 2.0 * resolution:
        return []
    return [
        f'the map is made of road up to {used:.1f} m ahead, though the view reaches {seen:.1f} m: '
        f'pixels beyond are longer than {LONGEST_PIXEL:g} cells of {resolution:g} m; a coarser '
        '--resolution uses more'
    ]


def map_rows(drive: MappedDrive, raster_map: RasterMap) -> list[TableRow]:
    """Return the rows of the summary about frames and map."""
    valid, noise = raster_map.valid, raster_map.noise
    assert valid is not None
    assert noise is not None
    low_x, low_y, high_x, high_y = raster_map.bounds
    gains = [exposure.gain for exposure in drive.builder.exposures]
    corner = float(drive.camera.vignetting.lift(np.array(1.0)))
    median_noise = np.median(on_unit_scale(noise[valid]))
    return [
        TableRow('frames used', str(drive.builder.frames), ''),
        *(TableRow(f'frames skipped: {kind}', str(count), drive.first[kind])
          for kind, count in drive.skipped.items()),
        TableRow('road used, farthest ahead', f'{drive.camera.farthest[0]:.2f}', 'm'),
        TableRow('frames without overlap', str(drive.builder.without_overlap), ''),
        TableRow('gain relative to the first frame', f'{min(gains):.3f} to {max(gains):.3f}', ''),
        TableRow('grey of the map, relative to the first frame', f'{drive.builder.scale:.3f}', ''),
        TableRow('vignetting correction in the corners', f'{corner:.3f}', ''),
        TableRow('cells seen', str(int(valid.sum())), f'of {raster_map.resolution:g} m'),
        TableRow('x', f'{low_x:.2f} to {high_x:.2f}', 'm'),
        TableRow('y', f'{low_y:.2f} to {high_y:.2f}', 'm'),
        TableRow('noise of a cell, median', f'{median_noise:.4f}', 'of full scale'),
    ]


def pose_rows(checked: PoseCheckResult | None) -> list[TableRow]:
    """Return the rows of the summary about the poses; none if they were not compared."""
    if checked is None:
        return []
    rows = [TableRow('pairs of frames compared', f'{len(checked.pairs)} of {checked.tried}', '')]
    if checked.pairs:
        rms = _disagreement(checked)
        rows += [
            TableRow('disagreement of poses and frames, x, y (rms)',
                     f'{1e3 * rms[0]:.1f}, {1e3 * rms[1]:.1f}', 'mm'),
            TableRow('the same in heading', f'{math.degrees(rms[2]):.3f}', 'deg'),
        ]
    if checked.errors is not None:
        accuracy = checked.errors.accuracy
        rows += [
            TableRow('estimated error of the poses, x and y each (sigma_xy of the map)',
                     f'{1e3 * accuracy.sigma_xy:.1f}', 'mm'),
            TableRow('the same in heading (sigma_yaw)',
                     f'{math.degrees(accuracy.sigma_yaw):.3f}', 'deg'),
        ]
    return rows


def _calibration_note(errors: PoseErrors) -> list[str]:
    """Return a note if all pairs disagree in proportion to the distance between the frames."""
    drift = errors.drift
    if np.abs(drift).max() < max(3.0 * errors.drift_sigma, LEAST_DRIFT):
        return []
    return [
        f'frames disagree by {100.0 * drift[0]:.1f} % ahead and {100.0 * drift[1]:.1f} % to the '
        f'left of the distance between them (standard deviation {100.0 * errors.drift_sigma:.1f} '
        '%), all alike: camera.z, camera.pitch, camera.yaw or the intrinsics do not fit; the '
        'poses are not to blame'
    ]


def _disagreement(checked: PoseCheckResult) -> Floats:
    """Return the root mean square (3,) of the disagreements."""
    return np.sqrt(np.mean([pair.disagreement**2 for pair in checked.pairs], axis=0))


def pose_notes(checked: PoseCheckResult | None) -> list[str]:
    """Return notes on poses that do not fit, or that could not be compared."""
    if checked is None:
        return ['the poses were not compared with the frames (--no-pose-check): the map counts as '
                'exact']
    if checked.errors is None:
        return [
            f'the error of the poses is not known: {len(checked.pairs)} of {checked.tried} pairs '
            f'of frames could be compared, at least {LEAST_PAIRS} are needed; the map counts as '
            'exact (state sigma_xy and sigma_yaw in its YAML if they are known)'
        ]
    notes = _calibration_note(checked.errors)
    for pair in checked.errors.outliers[:MOST_NAMED]:
        x, y, yaw = pair.disagreement
        notes.append(
            f'the poses at {pair.stamps_ns[0] * 1e-9:.3f} s and {pair.stamps_ns[1] * 1e-9:.3f} s '
            f'disagree by {math.hypot(x, y):.3f} m and {abs(math.degrees(yaw)):.2f} degrees with '
            'what the two frames see: one of them is wrong, or something hid the road'
        )
    if more := len(checked.errors.outliers) - MOST_NAMED:
        notes += [f'{more} more pairs disagree'] if more > 0 else []
    return notes
