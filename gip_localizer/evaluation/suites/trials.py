# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of single frames: render a frame, draw a start near it, localize, compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from dataclasses import field as dataclass_field
from functools import partial
import sys

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Status
from gip_localizer.core.guard import run_guarded
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import difference, Pose2
from gip_localizer.evaluation.suites.conditions import Setup
from gip_localizer.evaluation.suites.grounds import GROUNDS, noisy_map
from gip_localizer.evaluation.suites.model_errors import Warp
from gip_localizer.evaluation.wrong_bounds import DEFAULT_BOUNDS
from gip_localizer.parameters import Parameters
from gip_localizer.parameters.spec import Value
from gip_localizer.synthetic.drive import SyntheticDrive, SyntheticFrame
from gip_localizer.synthetic.localizer_parameters import CAR_VIEW, view_settings
from gip_localizer.synthetic.motions import make_motion
from gip_localizer.synthetic.scenarios import scenario_parameters

FRAME_NS = 1_000_000_000
"""Time between two trials, nanoseconds; chosen."""
PLACES = 100_000
"""Number of frames of a drive without end from which trials are drawn; chosen."""
ORIGIN = Pose2(0.0, 0.0, 0.0)
"""The identity (m, m, rad), by which a relative pose is subtracted."""


@dataclass(frozen=True)
class Spread:
    """Largest offsets of starts from the truth (m, m, rad)."""

    x: float = 0.5
    y: float = 0.5
    yaw: float = float(np.radians(3.0))

    def offset(self, rng: np.random.Generator) -> Pose2:
        """Draw an offset from the uniform law."""
        return Pose2(*(rng.uniform(-1, 1, 3) * [self.x, self.y, self.yaw]).tolist())

    @property
    def covariance(self) -> Floats:
        """Covariance (3, 3) of the offsets."""
        return np.diag(np.array([self.x, self.y, self.yaw]) ** 2 / 3.0)


@dataclass(frozen=True, eq=False)
class Trial:
    """
    The result of one frame.

    Attributes
    ----------
    status : str
        Status of the estimate.
    error : (3,) float64 or None
        Error of the published pose: ahead, left (m), yaw (rad), in the axes of the true pose.
    raw_error : (3,) float64 or None
        The same for the best match, published or not.
    covariance : (3, 3) float64 or None
        Covariance of the error, in the same axes.
    fisher : (3, 3) float64 or None
        Cramér-Rao bound of the error as estimated by the localizer.
    quality : dict
        Quality figures of the estimate.
    milliseconds : float
        Duration of the update.

    """

    status: str
    error: Floats | None = None
    raw_error: Floats | None = None
    covariance: Floats | None = None
    fisher: Floats | None = None
    quality: dict[str, float] = dataclass_field(default_factory=dict)
    milliseconds: float = 0.0

    @property
    def wrong(self) -> bool:
        """True if a pose was published whose error exceeds 0.5 m or 2 degrees."""
        return self.error is not None and is_wrong(self.error)

    @property
    def faulty(self) -> bool:
        """True if the localizer raised an unexpected exception."""
        return self.status == str(Status.FAULT)

    @property
    def nees(self) -> float:
        """Normalized squared error of the published pose; NaN without a published pose."""
        if self.error is None or self.covariance is None:
            return float('nan')
        return float(self.error @ np.linalg.solve(self.covariance, self.error))


def is_wrong(error: Floats) -> bool:
    """Return True if an error (ahead, left, yaw) exceeds 0.5 m or 2 degrees."""
    xy, yaw_deg = np.hypot(error[0], error[1]), np.degrees(abs(error[2]))
    return bool(xy > DEFAULT_BOUNDS.xy_m or yaw_deg > DEFAULT_BOUNDS.yaw_deg)


def bench_parameters(
    setup: Setup, drive: SyntheticDrive, overrides: Mapping[str, Value]
) -> Parameters:
    """Return the parameters of the localizer for the camera of a setup, whose yaw is exact."""
    held = drive.parameters.camera
    camera = {
        'camera.x': held.x, 'camera.y': held.y, 'camera.z': held.z, 'camera.roll': held.roll,
        'camera.pitch': held.pitch, 'camera.yaw': held.yaw, 'camera.rectified': held.rectified,
        'camera.sigma_yaw': 0.0,
    }
    return Parameters.from_dict({
        **camera, **view_settings(CAR_VIEW), 'motion.fuse': False, **setup.localizer, **overrides,
    })


class Bench:
    """
    Test bench: world, camera, map and localizer of a setup.

    Parameters
    ----------
    setup : Setup
        Settings for rendering and localizing.
    seed : int
        Seed of the world, the noise and the trials.
    overrides : dict
        Changes of the localizer's parameters, applied after those of the setup.

    """

    def __init__(self, setup: Setup, seed: int, overrides: Mapping[str, Value]) -> None:
        self.setup = setup
        self.seed = seed
        self.drive = SyntheticDrive(
            scenario_parameters(setup.scenario, {'seed': seed, 'world.seed': seed, **setup.camera})
        )
        if setup.ground != 'as made':
            self.drive.world = GROUNDS[setup.ground](self.drive.world)
            self.drive.motion = make_motion(self.drive.parameters.drive, self.drive.world.lane)
        self.raster_map: RasterMap = self.drive.raster_map
        if setup.map_noise > 0.0:
            self.raster_map = noisy_map(self.raster_map, setup.map_noise, seed)
        self._warp: Warp | None = None
        if setup.map_warp > 0.0:
            self._warp = Warp(self.raster_map, setup.map_warp, seed)
            self.raster_map = self._warp.warped()
        self.camera = setup.miscalibration.of(self.drive.camera)
        self.parameters = bench_parameters(setup, self.drive, overrides)
        self._localizer: Localizer | None = None
        self._stamp_ns = 0

    def rng(self, index: int) -> np.random.Generator:
        """Return the random number generator of a trial."""
        return np.random.default_rng([self.seed, 90210, index])

    def frame(self, rng: np.random.Generator) -> SyntheticFrame:
        """Render a frame at a random place along the lane."""
        places = min(PLACES, int(self.drive.motion.duration * self.drive.parameters.rate)
                     if np.isfinite(self.drive.motion.duration) else PLACES)
        return self.drive.frame(int(rng.integers(0, places)))

    def restart(self) -> None:
        """Localize the next frame with a new localizer."""
        self._localizer = None

    def renew(self) -> None:
        """Start again with changed constants of search and refinement; keep the rectifier."""
        if self._localizer is not None and self._localizer.prepared is not None:
            self._localizer.change_map(self.raster_map)  # the parts of the map are cut again
            self._localizer.prepared.renew_refiner()
            self._localizer.state.forget_calibration()

    def localize(self, image: Grey, prior: Pose2, covariance: Floats) -> Estimate:
        """Localize one frame from a new prior, independent of earlier frames."""
        if self._localizer is None:
            self._localizer = Localizer(self.raster_map, self.parameters)
        self._stamp_ns += FRAME_NS
        self._localizer.set_prior(self._stamp_ns, prior, covariance)
        return localized(self._localizer, self._stamp_ns, image, self.camera)

    def trial(self, index: int, spread: Spread) -> Trial:
        """Render, start near the truth, localize and compare."""
        image, truth, start = self.scene(index, spread)
        return compared(self.localize(image, start, spread.covariance), truth)

    def scene(self, index: int, spread: Spread) -> tuple[Grey, Pose2, Pose2]:
        """Render the image of a trial; return it with its true pose and a start near it."""
        rng = self.rng(index)
        frame = self.frame(rng)
        truth = self.truth(frame)
        return frame.image, truth, truth @ spread.offset(rng)

    def truth(self, frame: SyntheticFrame) -> Pose2:
        """Return where the map has the vehicle of a frame."""
        if self._warp is None:
            return frame.truth
        return self._warp.truth(frame.truth, self.parameters.birdseye)


def localized(
    localizer: Localizer, stamp_ns: int, image: Grey, camera: CameraModel
) -> Estimate:
    """Localize a frame; an unexpected exception is printed and affects only this frame."""
    work = partial(localizer.update, stamp_ns, image, camera)
    return run_guarded(work, stamp_ns, partial(print, file=sys.stderr))


def compared(estimate: Estimate, truth: Pose2) -> Trial:
    """Return the trial of an estimate."""
    fit = estimate.match.fit if estimate.match else None
    error = raw = covariance = None
    if fit is not None:
        raw = difference(truth.inverse() @ fit.pose, ORIGIN)
        if estimate.published:
            error, covariance = raw, fit.covariance
    return Trial(
        str(estimate.status), error, raw, covariance, fit.fisher if fit else None,
        estimate.quality, sum(estimate.timings_ms.values()),
    )
