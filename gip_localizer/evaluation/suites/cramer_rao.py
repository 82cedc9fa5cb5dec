# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Suite `bound`: errors relative to the Cramér-Rao bound, in frames dominated by noise.

The bound comes from the renderer and the true noise alone: with image h(x, y, yaw, gain, offset)
and white noise of variance σ² per pixel the information is `J^T J / σ²` over the pixels that see
the road in the view, and no unbiased estimate of the pose has less than its inverse's block.

"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import lru_cache
import math

import numpy as np

from gip_localizer.core.arrays import Bools, Floats
from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.suites.conditions import CAR_CAMERA, Setup, STILL, TILES
from gip_localizer.evaluation.suites.suite import Bound, Cell, of_part, Record, Section
from gip_localizer.evaluation.suites.trials import Bench, compared, Spread
from gip_localizer.parameters.spec import Value
from gip_localizer.synthetic.renderer import Renderer

MOST_RATIO = 1.2
"""Largest allowed ratio (no unit) of the error to its bound; chosen."""
MOST_FRAMES = 40
"""Largest number of frames per setup, because a frame is rendered seven times more; chosen."""
STEPS = np.array([0.004, 0.004, 0.001])
"""Steps of the numerical derivatives along x, y (m) and yaw (rad); chosen."""
PURE: dict[str, Value] = {
    'sensor.bits': 16, 'sensor.full_well': 0.0, 'sensor.vignetting': 0.0,
    'sensor.exposure_time': 0.0, 'world.resolution': 0.05, 'world.join': 1,
}
"""White noise as the only disturbance, and a map that equals the world."""
FINE: dict[str, Value] = {**STILL, 'birdseye.resolution': 0.05 / 4.0}
"""Four view cells per side of a map cell, so that little detail is lost by averaging."""
SETUPS = (
    replace(TILES, name='tiles, -3 dB', camera={**TILES.camera, **PURE},
            localizer={**TILES.localizer, 'birdseye.resolution': 0.05 / 6.0}),
    Setup(
        name='road, noise 0.2', title='the road, white noise of a fifth of full scale',
        scenario='clear', camera={**CAR_CAMERA, **PURE, 'sensor.read_noise': 0.2,
                                  'sensor.gain': 0.6, 'sensor.offset': 0.2},
        localizer=FINE,
    ),
    Setup(
        name='road, noise 0.3', title='the road, white noise of three tenths of full scale',
        scenario='clear', camera={**CAR_CAMERA, **PURE, 'sensor.read_noise': 0.3,
                                  'sensor.gain': 0.6, 'sensor.offset': 0.2},
        localizer=FINE,
    ),
)
"""Setups with noise of -3 dB, or in fractions of full scale; chosen."""


class CramerRao:
    """Ratios of the errors to the bound, for each axis and combined."""

    name = 'bound'
    title = 'Errors relative to the Cramér-Rao bound where noise dominates'
    columns = (
        'frames of', 'frames', 'rmse [mm]', 'bound [mm]', 'yaw [mdeg]', 'bound [mdeg]',
        'ahead', 'left', 'yaw', 'combined', 'reported sigma / bound',
    )

    @property
    def setups(self) -> Mapping[str, Setup]:
        """Setups by name."""
        return {setup.name: setup for setup in SETUPS}

    def count(self, part: str, frames: int) -> int:
        """Return the number of trials per setup."""
        return min(frames, MOST_FRAMES)

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame and compute its bound."""
        rng = bench.rng(index)
        frame = bench.frame(rng)
        start = frame.truth @ Spread(0.2, 0.2, 0.02).offset(rng)
        trial = compared(bench.localize(frame.image, start, Spread().covariance), frame.truth)
        bound = pose_bound(bench, frame.truth)
        figures = {f'bound_{i}{j}': float(bound[i, j]) for i in range(3) for j in range(3)}
        return [Record(self.name, part, index, '', trial, figures)]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return the ratios of root mean square errors to bounds."""
        rows: list[Sequence[Cell]] = []
        demands: list[Bound] = []
        for setup in SETUPS:
            row, combined = _row(setup.name, of_part(records, setup.name))
            rows.append(row)
            demands.append(Bound(setup.name, 'error over its bound', combined, MOST_RATIO))
        return Section(self.name, self.title, self.columns, rows, demands, (
            'combined: root of the mean of e^T C^-1 e / 3 with the bound C; 1 is the best value '
            'of an unbiased estimate. All matches count, published or not.',
        ))


def pose_bound(bench: Bench, truth: Pose2) -> Floats:
    """
    Least covariance (3, 3) of an unbiased estimate of the pose, for unknown gain and offset.

    The axes are ahead and left of the true pose in metres, and yaw in radians.

    """
    sensor = bench.drive.parameters.sensor
    renderer = _renderer(bench)
    seen = _pixels_of_view(bench)
    columns = []
    for step in np.diag(STEPS).tolist():
        ahead = renderer.render(truth @ Pose2(*step))[seen]
        behind = renderer.render(truth @ Pose2(*(-s for s in step)))[seen]
        columns.append(sensor.gain * (ahead - behind) / (2.0 * sum(step)))
    columns += [renderer.render(truth)[seen], np.ones(np.count_nonzero(seen))]
    jacobian = np.stack(columns, axis=1)
    information = (jacobian.T @ jacobian).astype(np.float64) / sensor.read_noise**2
    return np.asarray(np.linalg.inv(information)[:3, :3])


@lru_cache(maxsize=1)
def _renderer(bench: Bench) -> Renderer:
    return Renderer(bench.drive.world.raster, bench.drive.camera)


@lru_cache(maxsize=1)
def _pixels_of_view(bench: Bench) -> Bools:
    """Return True for the pixels (height, width) whose road lies in the bird's-eye view."""
    camera, view = bench.drive.camera, bench.parameters.birdseye
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    xy, valid = camera.road_points(np.stack([u.ravel(), v.ravel()], axis=1).astype(float))
    inside = (
        valid & (xy[:, 0] >= view.near) & (xy[:, 0] < view.far)
        & (np.abs(xy[:, 1]) < view.half_width)
    )
    return np.asarray(inside.reshape(camera.height, camera.width))


def _row(name: str, records: Sequence[Record]) -> tuple[list[Cell], float]:
    found = [r for r in records if r.trial.raw_error is not None]
    if not found:
        return [name, len(records), *[math.nan] * 9], math.nan
    errors = np.array([r.trial.raw_error for r in found])
    bounds = np.array([
        [[r.figures[f'bound_{i}{j}'] for j in range(3)] for i in range(3)] for r in found
    ])
    least = np.sqrt(np.diagonal(bounds, axis1=1, axis2=2))
    axes = np.sqrt((errors**2).mean(axis=0) / (least**2).mean(axis=0))
    squares = [e @ np.linalg.solve(c, e) for e, c in zip(errors, bounds, strict=True)]
    combined = math.sqrt(float(np.mean(squares)) / 3.0)
    sigma = np.array([
        np.trace(np.linalg.solve(c, r.trial.covariance)) / 3.0
        for r, c in zip(found, bounds, strict=True) if r.trial.covariance is not None
    ])
    rms = np.sqrt((errors**2).mean(axis=0))
    bound = np.sqrt((least**2).mean(axis=0))
    reported = math.sqrt(float(sigma.mean())) if len(sigma) else math.nan
    return [
        name, len(records), round(1e3 * float(np.hypot(*rms[:2])), 3),
        round(1e3 * float(np.hypot(*bound[:2])), 3), round(1e3 * math.degrees(rms[2]), 2),
        round(1e3 * math.degrees(bound[2]), 2), *(round(float(a), 2) for a in axes),
        round(combined, 3), round(reported, 2),
    ], combined
