# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
Mounting pose of a camera from frames with known poses on a map.

A match locates the camera on the map: the pose of base that it gives is right if the mounting
pose is. With T the known pose of base, T' the matched one, and M the mounting pose with the
pitch, roll and height of the match, the true mounting pose is `T⁻¹ T' M`. Each round takes the
median over the frames, and starts the next one from it with a narrower search.

"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Parameters

COMPONENTS = ('x', 'y', 'z', 'roll', 'pitch', 'yaw')
"""Of a mounting pose: metres, then radians."""
LEAST_FRAMES = 3
"""Least number of frames that must agree in a round; chosen."""
SAME = np.array([0.1, 0.1, 0.1, 0.02, 0.02, 0.02])
"""Largest distance (m, rad) from the median of a frame that counts; chosen: a match at a wrong
place is farther off."""
STEP_NS = 1_000_000_000
"""Time between two frames for the localizer, ns; chosen: each begins from its known pose."""
START_SIGMAS = (0.3, 0.06)
"""Standard deviations of the start of a match in the first round, m and rad; chosen: a mounting
pose that is 0.1 m and 3 degrees off."""


class Round(NamedTuple):
    """
    A pass over some frames.

    Attributes
    ----------
    frames : int
        Number of frames; 0: all.
    pitch, roll, height : float
        Standard deviations of the mounting pose: rad, rad, m.
    reach, turn : float
        Half-widths of the search: m, rad.

    """

    frames: int
    pitch: float
    roll: float
    height: float
    reach: float
    turn: float


ROUNDS = (
    Round(frames=24, pitch=0.06, roll=0.06, height=0.1, reach=1.0, turn=0.12),
    Round(frames=12, pitch=0.02, roll=0.02, height=0.05, reach=0.5, turn=0.06),
    Round(frames=0, pitch=0.01, roll=0.01, height=0.03, reach=0.5, turn=0.06),
)
"""Passes; chosen: from an error of 3 degrees and 0.1 m to the final averages."""


class KnownFrame(NamedTuple):
    """An image (height, width) and the known pose of base in the map at its exposure."""

    image: Grey
    pose: Pose2


@dataclass(frozen=True, eq=False)
class MountResult:
    """
    A calibrated mounting pose.

    Attributes
    ----------
    extrinsics : Extrinsics
        The mounting pose.
    covariance : (6, 6) float64
        Of its mean over the frames: x, y, z (m), roll, pitch, yaw (rad). Errors that all frames
        share, as of the map, are not in it.
    used, tried : int
        Number of frames that count, and of all.

    """

    extrinsics: Extrinsics
    covariance: Floats
    used: int
    tried: int

    @property
    def sigmas(self) -> Floats:
        """Standard deviations (6,): m, m, m, rad, rad, rad."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class MountCalibration:
    """
    Calibration of a mounting pose.

    Parameters
    ----------
    frames : sequence of KnownFrame
        Frames, spread over the drive.
    camera : CameraModel
        Intrinsics, and the mounting pose from which the search starts.
    raster_map : RasterMap
        The map.
    parameters : Parameters
        Parameters of the matching.
    fixed : sequence of str
        Components (`COMPONENTS`) that keep their value.

    """

    def __init__(
        self, frames: Sequence[KnownFrame], camera: CameraModel, raster_map: RasterMap,
        parameters: Parameters, fixed: Sequence[str] = (),
    ) -> None:
        self._frames, self._camera, self._map = frames, camera, raster_map
        self._parameters, self._fixed = parameters, frozenset(fixed)

    @property
    def steps(self) -> int:
        """Number of matches that `run` tries at most."""
        return sum(len(self._chosen(one)) for one in ROUNDS)

    def run(self, on_frame: Callable[[], object]) -> MountResult:
        """
        Calibrate; `on_frame` is called after each match. Deterministic.

        Raises
        ------
        CalibrationError
            Too few frames agree.

        """
        mount = _vector(self._camera.extrinsics)
        for one in ROUNDS:
            chosen = self._chosen(one)
            samples = self._samples(one, chosen, mount, on_frame)
            kept = _agreeing(samples)
            if len(kept) < LEAST_FRAMES:
                raise CalibrationError(
                    f'{len(kept)} of {len(chosen)} frames agree on a mounting pose within 0.1 m '
                    f'and 1 degree, at least {LEAST_FRAMES} must: start from a pose that is less '
                    'than 0.1 m and 3 degrees off (camera.*; pitch is positive when the camera '
                    'looks down, and the angles are not those of the optical frame), with poses '
                    'of base_link on this map'
                )
            mount = self._kept_fixed(np.median(kept, axis=0), mount)
        mean = self._kept_fixed(kept.mean(axis=0), mount)
        return MountResult(
            Extrinsics(*mean.tolist()), np.cov(kept.T) / len(kept), len(kept), len(self._frames)
        )

    def _chosen(self, one: Round) -> list[KnownFrame]:
        count = min(one.frames or len(self._frames), len(self._frames))
        places = np.linspace(0, len(self._frames) - 1, count).round().astype(int)
        return [self._frames[k] for k in np.unique(places).tolist()]

    def _samples(
        self, one: Round, frames: list[KnownFrame], mount: Floats,
        on_frame: Callable[[], object],
    ) -> Floats:
        """Return the mounting poses (n, 6) that the frames give."""
        localizer = Localizer(self._map, self._settings(one))
        camera = self._camera.with_extrinsics(Extrinsics(*mount.tolist()))
        sigma, sigma_yaw = START_SIGMAS
        spread = np.diag([sigma**2, sigma**2, sigma_yaw**2])
        samples = []
        for number, frame in enumerate(frames):
            stamp = (number + 1) * STEP_NS
            localizer.set_prior(stamp, frame.pose, spread)
            estimate = localizer.update(stamp, frame.image, camera)
            fit = estimate.match.fit if estimate.match is not None else None
            if estimate.published and fit is not None:
                samples.append(_seen_mount(frame.pose, fit.pose, mount, fit.camera_motion))
            on_frame()
        return np.array(samples).reshape(-1, len(COMPONENTS))

    def _settings(self, one: Round) -> Parameters:
        motion = {'pitch': one.pitch, 'roll': one.roll, 'height': one.height}
        held = {'height' if name == 'z' else name for name in self._fixed}
        return self._parameters.replace({
            **{f'camera_motion.sigma_{name}': 0.0 if name in held else sigma
               for name, sigma in motion.items()},
            'search.x': one.reach, 'search.y': one.reach, 'search.yaw': one.turn,
            'motion.fuse': False, 'camera.sigma_yaw': 0.0,
        })

    def _kept_fixed(self, found: Floats, before: Floats) -> Floats:
        fixed = np.array([name in self._fixed for name in COMPONENTS])
        return np.where(fixed, before, found)


def _vector(mount: Extrinsics) -> Floats:
    return np.array([getattr(mount, name) for name in COMPONENTS])


def _seen_mount(known: Pose2, matched: Pose2, mount: Floats, motion: Floats) -> Floats:
    """Return the mounting pose (6,) with which the match would give the known pose."""
    moved = known.inverse() @ matched
    position = moved.transform(mount[:2])
    pitch, roll, height = motion
    return np.array([
        *position, mount[2] + height, mount[3] + roll, mount[4] + pitch, mount[5] + moved.yaw,
    ])


def _agreeing(samples: Floats) -> Floats:
    """Return the samples (n, 6) near the one that most others agree with."""
    if len(samples) == 0:
        return samples
    near = [np.all(np.abs(samples - one) < SAME, axis=1) for one in samples]
    return np.asarray(samples[max(near, key=np.count_nonzero)])
