# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Suite `model-error`: what is published where road, map, calibration or light deviate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
import math

import numpy as np

from gip_localizer.evaluation.error_table import ELLIPSE_95
from gip_localizer.evaluation.suites.conditions import CAR_CAMERA, Setup
from gip_localizer.evaluation.suites.model_errors import Miscalibration
from gip_localizer.evaluation.suites.single_frame import MOST_SIGMA_RATIO, Summary, summary
from gip_localizer.evaluation.suites.suite import (
    Bound,
    Cell,
    of_part,
    ratio,
    Record,
    Section,
    share,
)
from gip_localizer.evaluation.suites.trials import Bench, Spread, Trial
from gip_localizer.parameters import Parameters
from gip_localizer.parameters.spec import Value

MOST_NEES = 4.5
"""Largest mean NEES (no unit); chosen: standard deviations too small by a factor of 1.22."""
LEAST_INSIDE = 0.85
"""Least share of published poses with the truth in their 95 % ellipse; chosen."""
LEAST_PUBLISHED = 0.9
"""Least share of frames with a published pose; chosen."""
SIGMA_YAW = Parameters().camera.sigma_yaw  # rad: the default, whatever the cause is


@dataclass(frozen=True, kw_only=True)
class ModelError(Setup):
    """
    One cause.

    Attributes
    ----------
    rmse_xy_m : float
        Largest root mean square error of the position.

    """

    rmse_xy_m: float


def _cause(
    name: str, title: str, rmse_xy_m: float, scenario: str = 'clear', *,
    map_warp: float = 0.0, miscalibration: Miscalibration | None = None,
    localizer: Mapping[str, Value] | None = None,
    camera: Mapping[str, Value] = CAR_CAMERA,
) -> ModelError:
    return ModelError(
        name=name, title=title, scenario=scenario, camera=dict(camera),
        localizer={'camera.sigma_yaw': SIGMA_YAW, **(localizer or {})}, map_warp=map_warp,
        miscalibration=miscalibration or Miscalibration(),
        rmse_xy_m=rmse_xy_m,
    )


CAUSES = (
    _cause('crown', 'cross slope of 2.5 % to both sides', 0.030, 'crown'),
    _cause('grade', 'slope that changes by 6 % over 30 m', 0.030, 'grade'),
    _cause('bank', 'curves banked by 4 %', 0.030, 'bank'),
    _cause('warp', 'map bent by 5 cm over 20 m', 0.015, map_warp=0.05),
    _cause('pitch', 'calibrated pitch off by 0.3 degrees', 0.060,
           miscalibration=Miscalibration(pitch=math.radians(0.3))),
    _cause('yaw', 'calibrated yaw off by 0.2 degrees', 0.060,
           miscalibration=Miscalibration(yaw=math.radians(0.2))),
    _cause('height', 'calibrated height 2 cm too large', 0.060,
           miscalibration=Miscalibration(height=0.02)),
    _cause('low', 'calibrated height 2 cm too small', 0.060,
           miscalibration=Miscalibration(height=-0.02)),
    _cause('focal', 'focal length 0.5 % too large', 0.060,
           miscalibration=Miscalibration(focal=0.005)),
    _cause('tone', 'tone curve of power 0.6, hunting exposure', 0.015, 'tone'),
    _cause('glare', 'glare of a low sun', 0.015, 'glare'),
    _cause('shadows', 'hard shadows that the map lacks', 0.015, 'shadows'),
    _cause('relaid', 'new asphalt on 60 %, paint kept', 0.015, 'relaid'),
    _cause('rolling', 'rolling shutter of 25 ms at 12 m/s', 0.020, 'rolling-shutter'),
    _cause('nadir', 'camera 8 m up that looks down, 2 cm and 0.3 degrees off', 0.060, 'nadir',
           camera={}, localizer={
               'birdseye.near': -3.0, 'birdseye.far': 3.0, 'birdseye.half_width': 3.5,
           }, miscalibration=Miscalibration(pitch=math.radians(0.3), height=0.02)),
    _cause('together', 'crown, grade, bank, warp and calibration', 0.060, 'real-road',
           map_warp=0.05, miscalibration=Miscalibration(
               pitch=math.radians(0.3), yaw=math.radians(0.2), height=0.02, focal=0.005)),
)


class ModelErrors:
    """Starts spread over ±0.5 m and ±3°, no filter, where the model of a frame is wrong."""

    name = 'model-error'
    title = 'Single frames, no filter, where road, map, calibration or light are wrong'
    columns = (
        'cause', 'frames', 'published', 'rmse [mm]', 'bound', 'largest [mm]', 'yaw [deg]',
        'wrong', 'NEES', 'inside', 'sigma/rmse', 'unfiltered rmse [mm]',
    )

    @property
    def setups(self) -> Mapping[str, ModelError]:
        """The causes by name."""
        return {cause.name: cause for cause in CAUSES}

    def count(self, part: str, frames: int) -> int:
        """Return the trials of each cause."""
        return frames

    def run(self, bench: Bench, part: str, index: int) -> list[Record]:
        """Localize one frame."""
        return [Record(self.name, part, index, '', bench.trial(index, Spread()))]

    def summarise(self, records: Sequence[Record]) -> Section:
        """Return one row per cause."""
        rows: list[Sequence[Cell]] = []
        demands: list[Bound] = []
        for cause in CAUSES:
            trials = [r.trial for r in of_part(records, cause.name)]
            found, inside = summary(trials), share_inside(trials)
            rows.append(_row(cause, found, inside))
            demands += _bounds(cause, found, inside)
        return Section(self.name, self.title, self.columns, rows, demands, (
            'inside: share of the published poses whose 95 % ellipse holds the truth.',
        ))


def share_inside(trials: Sequence[Trial]) -> float:
    """Share of the published poses with the true position in their 95 % ellipse."""
    shown = [t for t in trials if t.error is not None and t.covariance is not None]
    inside = 0
    for trial in shown:
        assert trial.error is not None
        assert trial.covariance is not None
        xy = trial.error[:2]
        inside += float(xy @ np.linalg.solve(trial.covariance[:2, :2], xy)) <= ELLIPSE_95
    return share(inside, len(shown))


def _bounds(cause: ModelError, found: Summary, inside: float) -> list[Bound]:
    row = cause.name
    return [
        Bound(row, 'rmse of the position [mm]', 1e3 * found.rmse_xy, 1e3 * cause.rmse_xy_m),
        Bound(row, 'wrong poses published', found.wrong, 0),
        Bound(row, 'published', share(found.published, found.frames), LEAST_PUBLISHED,
              at_most=False),
        Bound(row, 'mean NEES', found.nees, MOST_NEES),
        Bound(row, 'truth inside the ellipse', inside, LEAST_INSIDE, at_most=False),
        Bound(row, 'sigma over rmse, position', ratio(found.sigma_xy, found.rmse_xy),
              MOST_SIGMA_RATIO),
    ]


def _row(cause: ModelError, found: Summary, inside: float) -> list[Cell]:
    return [
        cause.name, found.frames, f'{share(found.published, found.frames):.1%}',
        round(1e3 * found.rmse_xy, 2), f'{1e3 * cause.rmse_xy_m:g}',
        round(1e3 * found.largest_xy, 1), round(math.degrees(found.rmse_yaw), 4),
        found.wrong, round(found.nees, 2), f'{inside:.1%}',
        round(ratio(found.sigma_xy, found.rmse_xy), 2), round(1e3 * found.raw_rmse_xy, 2),
    ]
