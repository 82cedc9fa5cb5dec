# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The localizer: one frame in, one estimate out.

`Localizer.update` is the data flow: 1 bird's-eye view, 2 Gramian, 3 scores, 4 posterior.

"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
import math
import time

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.birdseye import View
from gip_localizer.core.camera import CameraModel
from gip_localizer.core.estimate import Estimate, Match, Status
from gip_localizer.core.fit import Fit
from gip_localizer.core.gramian import estimate_pixel_noise, gramian
from gip_localizer.core.integrity import judge, Verdict
from gip_localizer.core.odometry import OdometrySample, REWIND_NS
from gip_localizer.core.optics import Optics
from gip_localizer.core.pose import Pose2
from gip_localizer.core.posterior import contrast
from gip_localizer.core.raster_map import RasterMap
from gip_localizer.core.recovery import global_search
from gip_localizer.core.search import Extent, Found, search_window
from gip_localizer.core.tracker import Belief, checked_prior, Tracker
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Parameters

FIRST_FIX_SIGMAS = 2.0  # a first prior's window covers this many standard deviations
FIRST_FIX_LIMITS = (5.0, 0.6)  # m, rad: but no more than this


class Localizer:
    """
    Matches camera frames against a map.

    Parameters
    ----------
    raster_map : RasterMap
        The map of the road.
    parameters : Parameters
        All tunables; replace them between frames with `configure`.

    """

    def __init__(self, raster_map: RasterMap, parameters: Parameters) -> None:
        self.raster_map = raster_map
        self.parameters = parameters
        self.tracker = Tracker(parameters.motion)
        self.misses = 0
        self._unconfirmed = 0
        self._search_map = False
        self._last_search_ns: int | None = None
        self._last_stamp_ns: int | None = None
        self._optics: Optics | None = None
        self._timings: dict[str, float] = {}
        self._start()

    def _start(self) -> None:
        pose = self.parameters.initial_pose
        self.tracker.reset(None)
        self.misses = 0
        self._unconfirmed = 0
        self._fresh_prior = True
        if pose.set:
            covariance = np.diag([pose.sigma_xy**2, pose.sigma_xy**2, pose.sigma_yaw**2])
            self.tracker.reset(Belief(-(1 << 62), Pose2(pose.x, pose.y, pose.yaw), covariance))

    @property
    def lost(self) -> bool:
        """Whether too many frames in a row gave no fix."""
        return self.misses >= self.parameters.integrity.lost_after

    def configure(self, parameters: Parameters) -> None:
        """Take new parameters from the next frame on; the belief stays."""
        self.parameters = parameters
        self.tracker.configure(parameters.motion)
        self._optics = None

    def set_prior(self, stamp_ns: int, pose: Pose2, covariance: Floats) -> None:
        """
        Start from a pose given from outside.

        Parameters
        ----------
        stamp_ns : int
            When it held, nanoseconds; 0: now.
        pose : Pose2
            Base in map.
        covariance : (3, 3) float64
            Of x, y (m), yaw (rad), map axes.

        Raises
        ------
        PriorError
            NaN or a covariance that is not positive definite; the belief stays as it was.

        """
        self.tracker.reset(checked_prior(stamp_ns, pose, covariance))
        self.misses = 0
        self._unconfirmed = 0
        self._search_map = False
        self._fresh_prior = True
        if self._optics is not None:
            self._optics.gain = 1.0

    def prepare(self, camera: CameraModel) -> None:
        """Precompute what a camera needs before its first frame, which tells what is wrong."""
        self._prepare(0, camera)

    def add_odometry(self, sample: OdometrySample) -> bool:
        """Take an odometry sample; False where it is refused."""
        return self.tracker.odometry.add(sample)

    def relocalize(self) -> None:
        """Search the whole map from the next frame on, until the place is found."""
        self._search_map = True
        self._last_search_ns = None

    def update(
        self, stamp_ns: int, image: Grey, camera: CameraModel, *, mask: Grey | None = None
    ) -> Estimate:
        """
        Localize one frame.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the image, nanoseconds.
        image : (height, width) uint8, uint16 or float32
            Grey image of the camera's size.
        camera : CameraModel
            Calibrated camera.
        mask : (height, width) uint8 or None
            Pixels below half of full scale are not looked at (the bonnet, other cars).

        Returns
        -------
        Estimate
            A pose with covariance, or the reason why there is none.

        """
        self._timings = {}
        refused = self._out_of_order(stamp_ns) or self._prepare(stamp_ns, camera)
        if refused is not None:
            return refused
        prior = self._prior(stamp_ns)
        search_map = self._search_due(stamp_ns)
        if prior is None and not search_map:
            return self._waiting(stamp_ns)

        with self._stage('birdseye'):  # 1 mean per cell
            view = self._optics_now.rectifier.rectify(image)

        with self._stage('gramian'):  # 2 weight per cell
            weight = self._weigh(view, image)
            if mask is not None:
                weight = weight * self._optics_now.rectifier.unmasked(mask)

        with self._stage('match'):  # 3 score per candidate, best modes refined
            found = self._search(stamp_ns, view, weight, None if search_map else prior)

        with self._stage('posterior'):  # 4 belief, or silence
            return self._conclude(stamp_ns, Match(view, weight), found, prior)

    def _out_of_order(self, stamp_ns: int) -> Estimate | None:
        last = self._last_stamp_ns
        if last is not None and stamp_ns <= last:
            if last - stamp_ns <= REWIND_NS:
                return self._silent(stamp_ns, Status.OUT_OF_ORDER, (
                    f'frame is {(last - stamp_ns) * 1e-6:.1f} ms behind the one before; skipped'
                ))
            self._start()
            self.tracker.odometry.clear()
        self._last_stamp_ns = stamp_ns
        return None

    def _prepare(self, stamp_ns: int, camera: CameraModel) -> Estimate | None:
        try:
            with self._stage('calibrate'):
                if self._optics is None or self._optics.key != camera.key():
                    self._optics = Optics(camera, self.parameters)
        except CalibrationError as error:
            self._optics = None
            return self._silent(stamp_ns, Status.NO_ROAD_IN_VIEW, str(error))
        return None

    @property
    def _optics_now(self) -> Optics:
        assert self._optics is not None
        return self._optics

    def _prior(self, stamp_ns: int) -> Belief | None:
        belief = self.tracker.belief
        if belief is not None and (belief.stamp_ns <= 0 or belief.stamp_ns > stamp_ns):
            self.tracker.belief = replace(belief, stamp_ns=stamp_ns)
        return self.tracker.predict(stamp_ns)

    def _weigh(self, view: View, image: Grey) -> Floats:
        score = self.parameters.score
        noise = score.pixel_noise or estimate_pixel_noise(image)
        gain = self._optics_now.gain if self._normalized else 1.0
        weight = gramian(view.footprint, pixel_noise=noise, map_noise=score.map_noise * gain)
        if score.metric.startswith('euclidean'):
            return view.valid * weight[view.valid].mean()
        return weight

    def _extent(self, prior: Belief) -> Extent:
        search, score = self.parameters.search, self.parameters.score
        x, y, yaw = search.x, search.y, search.yaw
        if self._fresh_prior:
            sigma = math.sqrt(max(prior.covariance[0, 0], prior.covariance[1, 1]))
            sigma_yaw = math.sqrt(prior.covariance[2, 2])
            wide = min(FIRST_FIX_SIGMAS * sigma, FIRST_FIX_LIMITS[0])
            wide_yaw = min(FIRST_FIX_SIGMAS * sigma_yaw, FIRST_FIX_LIMITS[1])
            x, y, yaw = max(x, wide), max(y, wide), max(yaw, wide_yaw)
        return Extent(x, y, yaw, search.yaw_step, score.min_overlap)

    def _search(
        self, stamp_ns: int, view: View, weight: Floats, prior: Belief | None
    ) -> Found | None:
        if contrast(view, weight) < self.parameters.integrity.min_contrast:
            return None
        optics, normalized = self._optics_now, self._normalized
        if prior is None:
            self._last_search_ns = stamp_ns
            return global_search(
                view, weight, self.raster_map, stamp_ns, self.parameters,
                refiner=optics.refiner,
            )
        return search_window(
            view, weight, self.raster_map, prior, self._extent(prior), refiner=optics.refiner,
            normalized=normalized,
        )

    @property
    def _normalized(self) -> bool:
        return self.parameters.score.metric.endswith('normalized')

    def _search_due(self, stamp_ns: int) -> bool:
        """Whether this frame is looked for on the whole map."""
        recovery = self.parameters.recovery
        if not (self._search_map or (self.lost and recovery.automatic)):
            return False
        since = math.inf if self._last_search_ns is None else stamp_ns - self._last_search_ns
        return since < 0 or since >= recovery.period * 1e9

    def _waiting(self, stamp_ns: int) -> Estimate:
        if self._search_map:
            return self._silent(stamp_ns, Status.LOST, (
                'not found on the map; the next search is due recovery.period '
                f'{self.parameters.recovery.period:g} s after the last'
            ))
        return self._silent(stamp_ns, Status.NO_PRIOR, (
            'no prior yet: publish initialpose, set initial_pose.*, or call ~/relocalize'
        ))

    @property
    def _confirmed(self) -> bool:
        """Whether the belief rests on published fixes."""
        return not (self._fresh_prior or self._unconfirmed or self.lost)

    def _conclude(
        self, stamp_ns: int, match: Match, found: Found | None, prior: Belief | None
    ) -> Estimate:
        searched_map = self._last_search_ns == stamp_ns
        vouching = prior if self._confirmed else None
        verdict = judge(match, found, self.parameters, prior=vouching)
        fit = verdict.fit
        match = Match(match.view, match.weight, found.scores if found else None, fit)
        if verdict.status is not Status.TRACKING or fit is None:
            return self._missed(stamp_ns, verdict, match, prior)
        self._optics_now.gain = fit.gain
        measured = Belief(stamp_ns, fit.pose, _in_map(fit))
        if searched_map or self.lost:
            self._search_map = False
            self._unconfirmed = self.parameters.recovery.confirm_frames
            self.tracker.reset(measured)
            prior = None
        belief = measured
        if prior is not None:
            belief = self.tracker.correct(prior, measured, fuse=self.parameters.motion.fuse)
        self.misses = 0
        self._fresh_prior = False
        if self._unconfirmed > 0:
            self._unconfirmed -= 1
        if self._unconfirmed > 0:
            verdict = Verdict(Status.CONFIRMING, (
                f'found on the map; {self._unconfirmed} more agreeing frames are needed'
            ), fit, verdict.quality)
            return self._estimate(stamp_ns, verdict, match, None)
        return self._estimate(stamp_ns, verdict, match, belief)

    def _missed(
        self, stamp_ns: int, verdict: Verdict, match: Match, prior: Belief | None
    ) -> Estimate:
        self.misses += 1
        if self._unconfirmed > 0:
            self._unconfirmed = 0
            self.misses = max(self.misses, self.parameters.integrity.lost_after)
        if prior is not None:
            self.tracker.miss(prior)
        if self.lost:
            verdict = Verdict(Status.LOST, (
                f'{self.misses} frames without a fix; last: {verdict.status}, {verdict.reason}'
            ), verdict.fit, verdict.quality)
        return self._estimate(stamp_ns, verdict, match, None)

    def _silent(self, stamp_ns: int, status: Status, reason: str) -> Estimate:
        return Estimate(stamp_ns, status, reason, timings_ms=dict(self._timings))

    def _estimate(
        self, stamp_ns: int, verdict: Verdict, match: Match, belief: Belief | None
    ) -> Estimate:
        return Estimate(
            stamp_ns, verdict.status, verdict.reason,
            belief.pose if belief else None, belief.covariance if belief else None,
            verdict.quality, self._timings, match,
        )

    @contextmanager
    def _stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        try:
            yield
        finally:
            self._timings[name] = 1e3 * (time.perf_counter() - start)


def _in_map(fit: Fit) -> Floats:
    """Covariance of a fit, turned from the pose's axes to the map's."""
    turn = np.eye(3)
    turn[:2, :2] = fit.pose.rotation()
    rotated: Floats = turn @ fit.covariance @ turn.T
    return 0.5 * (rotated + rotated.T)
