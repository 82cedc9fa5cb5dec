# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Single-frame trials: render a frame somewhere, start somewhere near, localize, compare."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from dataclasses import field as dataclass_field

import numpy as np

from gip_localizer.core.arrays import Floats
from gip_localizer.core.estimate import Estimate
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.evaluation.conditions import Condition
from gip_localizer.parameter_specs import Value
from gip_localizer.parameters import Parameters
from gip_localizer.synthetic.drive import SyntheticDrive
from gip_localizer.synthetic.scenarios import scenario_parameters

FRAME_NS = 1_000_000_000
WRONG_XY = 0.5  # m
WRONG_YAW = np.radians(2.0)


@dataclass(frozen=True)
class Spread:
    """Half-widths of the starts' offsets from the truth (m, m, rad)."""

    x: float = 0.5
    y: float = 0.5
    yaw: float = float(np.radians(3.0))


@dataclass(frozen=True, eq=False)
class Trial:
    """
    One frame's outcome.

    Attributes
    ----------
    status : str
        Status of the estimate.
    error : (3,) float64 or None
        Ahead, left (m) and yaw (rad) of the published pose, in the truth's axes.
    raw_error : (3,) float64 or None
        The same of the best match, published or not.
    covariance : (3, 3) float64 or None
        Of the error, in the same axes.
    fisher : (3, 3) float64 or None
        Cramér-Rao bound of the error.
    quality : dict
        The figures of the estimate.
    milliseconds : float
        Time of the update.

    """

    status: str
    error: Floats | None
    raw_error: Floats | None
    covariance: Floats | None
    fisher: Floats | None
    quality: dict[str, float] = dataclass_field(default_factory=dict)
    milliseconds: float = 0.0

    @property
    def wrong(self) -> bool:
        """Whether a pose was published that is off by more than 0.5 m or 2 degrees."""
        return self.error is not None and is_wrong(self.error)


def is_wrong(error: Floats) -> bool:
    """Whether an error (ahead, left, yaw) is beyond 0.5 m or 2 degrees."""
    return bool(np.hypot(error[0], error[1]) > WRONG_XY or abs(error[2]) > WRONG_YAW)


def localizer_parameters(
    condition: Condition, drive: SyntheticDrive, overrides: Mapping[str, Value]
) -> Parameters:
    """Return the parameters of the localizer for a condition's camera."""
    held = drive.parameters.camera
    camera = {
        'camera.x': held.x, 'camera.y': held.y, 'camera.z': held.z, 'camera.roll': held.roll,
        'camera.pitch': held.pitch, 'camera.yaw': held.yaw, 'camera.rectified': held.rectified,
    }
    return Parameters.from_dict(
        {**camera, 'motion.fuse': False, **condition.localizer, **overrides}
    )


def run_trials(
    condition: Condition, indices: range, *, seed: int, spread: Spread | None = None,
    overrides: Mapping[str, Value] | None = None,
) -> Iterator[Trial]:
    """
    Yield one trial per index; any range of indices gives the same trials.

    Parameters
    ----------
    condition : Condition
        What is rendered.
    indices : range
        Numbers of the trials.
    seed : int
        Of places, starts and noise.
    spread : Spread, optional
        Of the starts.
    overrides : dict, optional
        Parameters of the localizer on top of the condition's.

    """
    spread = spread or Spread()
    settings = scenario_parameters(condition.scenario, {**condition.camera, 'seed': seed})
    drive = SyntheticDrive(settings)
    localizer = Localizer(
        drive.raster_map, localizer_parameters(condition, drive, overrides or {})
    )
    sigma = np.array([spread.x, spread.y, spread.yaw]) / np.sqrt(3.0)
    for index in indices:
        rng = np.random.default_rng([seed, 90210, index])
        frame = drive.frame(int(rng.integers(0, 100_000)))
        offset = Pose2(*(rng.uniform(-1, 1, 3) * [spread.x, spread.y, spread.yaw]))
        stamp = (index + 1) * FRAME_NS
        localizer.set_prior(stamp, frame.truth @ offset, np.diag(sigma**2))
        estimate = localizer.update(stamp, frame.image, drive.camera)
        yield _trial(estimate, frame.truth)


def _trial(estimate: Estimate, truth: Pose2) -> Trial:
    fit = estimate.match.fit if estimate.match else None
    origin = Pose2(0.0, 0.0, 0.0)
    error = raw = covariance = None
    if fit is not None:
        raw = difference(truth.inverse() @ fit.pose, origin)
        if estimate.published:
            error, covariance = raw, fit.covariance
    return Trial(
        str(estimate.status), error, raw, covariance, fit.fisher if fit else None,
        estimate.quality, sum(estimate.timings_ms.values()),
    )
