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
from functools import cached_property, partial
import time

import numpy as np

from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.belief import Belief, checked_prior
from gip_localizer.core.birdseye.pixel_noise import estimate_pixel_noise
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.calibrated_view import CalibratedView
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Match, Status
from gip_localizer.core.gramian import gramian, most_gain
from gip_localizer.core.integrity import judge, Verdict
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.map.resampling import contrast
from gip_localizer.core.pose import Pose2
from gip_localizer.core.search.frame_search import FrameSearch
from gip_localizer.core.search.local_search import SearchResult
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.core.track.pose_filter import FilterState, PoseFilter
from gip_localizer.core.track.stamp_check import StampCheck
from gip_localizer.core.track.track_state import TrackState
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Parameters

NOW = -(1 << 62)  # stamp of a belief that holds at the next frame, whenever that comes


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
        self._crops = MapCrops(raster_map)
        self.parameters = parameters
        self.pose_filter = PoseFilter(parameters.motion)
        self.track_state = TrackState(parameters)
        self._order = StampCheck()
        self._before_hop = FilterState()
        self._gain = 1.0  # of the frame
        self._calibrated_view: CalibratedView | None = None
        self._timings: dict[str, float] = {}
        self._start()

    def _start(self) -> None:
        pose = self.parameters.initial_pose
        self.pose_filter.reset(None)
        self.track_state.started()
        if pose.set:
            covariance = np.diag([pose.sigma_xy**2, pose.sigma_xy**2, pose.sigma_yaw**2])
            self.pose_filter.reset(Belief(NOW, Pose2(pose.x, pose.y, pose.yaw), covariance))

    @property
    def went_back(self) -> float:
        """Seconds by which the last frame confirmed that time went back; 0: it did not."""
        return self._order.went_back

    @property
    def lost(self) -> bool:
        """Whether too many frames in a row gave no fix."""
        return self.track_state.lost

    def configure(self, parameters: Parameters) -> None:
        """Take new parameters from the next frame on; the belief stays."""
        self.parameters = parameters
        self.pose_filter.configure(parameters.motion)
        self.track_state.configure(parameters)

    def set_prior(self, stamp_ns: int, pose: Pose2, covariance: Floats) -> None:
        """
        Start from a pose given from outside.

        Parameters
        ----------
        stamp_ns : int
            When it held, nanoseconds; 0: now, which is also taken where it is long before the
            last frame: its clock is not the images'.
        pose : Pose2
            Base in map.
        covariance : (3, 3) float64
            Of x, y (m), yaw (rad), map axes.

        Raises
        ------
        PriorError
            NaN or a covariance that is not positive definite; the belief stays as it was.

        """
        if self._order.is_long_past(stamp_ns):
            stamp_ns = NOW
        self.pose_filter.reset(checked_prior(stamp_ns or NOW, pose, covariance))
        self.track_state.started()
        self.track_state.wanted = False
        self._order = StampCheck()
        if self._calibrated_view is not None:
            self._calibrated_view.gain = None

    def prepare(self, camera: CameraModel) -> None:
        """Precompute what a camera needs before its first frame, which tells what is wrong."""
        self._prepare(0, camera)

    def add_odometry(self, sample: OdometrySample) -> bool:
        """Take an odometry sample; False where it is refused."""
        return self.pose_filter.odometry.add(sample)

    def relocalize(self) -> None:
        """Search the whole map from the next frame on, until the place is found."""
        self.track_state.search()

    def searches(self, stamp_ns: int) -> bool:
        """Tell whether `update` would search the whole map for a frame, which takes seconds."""
        return self.track_state.search_due(stamp_ns)

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
        mask : (height, width) uint8, bool or None
            Pixels below half of full scale are not looked at (the bonnet, other cars).

        Returns
        -------
        Estimate
            A pose with covariance, or the reason why there is none.

        """
        self._timings = {}
        refused = (
            self._unusable(stamp_ns, image, camera, mask) or self._out_of_order(stamp_ns)
            or self._prepare(stamp_ns, camera)
        )
        if refused is not None:
            return refused
        prior = self._prior(stamp_ns)
        search_map = self.track_state.search_due(stamp_ns)
        if prior is None and not search_map:
            return self._waiting(stamp_ns)

        with self._stage('birdseye'):  # 1 mean per cell
            view = self._calibrated_view_now.rectifier.rectify(image)

        with self._stage('gramian'):  # 2 weight per cell
            weight = self._weigh(view, image)
            if mask is not None:
                weight = weight * self._calibrated_view_now.rectifier.unmasked(mask)

        with self._stage('match'):  # 3 score per candidate, best modes refined
            match = Match(view, weight)
            found, verdict = self._search(stamp_ns, match, prior, everywhere=search_map)

        with self._stage('posterior'):  # 4 belief, or silence
            return self._conclude(stamp_ns, match, found, verdict, prior)

    def _unusable(
        self, stamp_ns: int, image: Grey, camera: CameraModel, mask: Grey | None
    ) -> Estimate | None:
        size = (camera.height, camera.width)
        for name, pixels in (('image', image), ('mask', mask)):
            if pixels is not None and pixels.shape != size:
                return self._silent(stamp_ns, Status.BAD_IMAGE, (
                    f'the {name} has shape {pixels.shape}; expected grey of the camera\'s {size}'
                ))
        if image.dtype.kind == 'f' and not np.isfinite(image).all():
            return self._silent(stamp_ns, Status.BAD_IMAGE, 'the image holds NaN or infinity')
        return None

    def _out_of_order(self, stamp_ns: int) -> Estimate | None:
        fault = self._order.fault(stamp_ns)
        if fault:
            return self._silent(stamp_ns, Status.OUT_OF_ORDER, fault)
        if self._order.hopped:
            self._before_hop = self.pose_filter.known
        elif self._order.returned:
            self.pose_filter.known = self._before_hop
        elif self._order.went_back:
            self._start()
            self.pose_filter.odometry.clear()
        return None

    def _prepare(self, stamp_ns: int, camera: CameraModel) -> Estimate | None:
        try:
            with self._stage('calibrate'):
                view = self._calibrated_view
                if view is None or not view.serves(camera, self.parameters):
                    self._calibrated_view = CalibratedView(camera, self.parameters)
        except CalibrationError as error:
            self._calibrated_view = None
            return self._silent(stamp_ns, Status.NO_ROAD_IN_VIEW, str(error))
        return None

    @property
    def _calibrated_view_now(self) -> CalibratedView:
        assert self._calibrated_view is not None
        return self._calibrated_view

    def _prior(self, stamp_ns: int) -> Belief | None:
        belief = self.pose_filter.belief
        if belief is not None and (belief.stamp_ns == NOW or belief.stamp_ns > stamp_ns):
            self.pose_filter.belief = replace(belief, stamp_ns=stamp_ns)
        return self.pose_filter.predict(stamp_ns)

    def _weigh(self, view: View, image: Grey) -> Floats:
        score = self.parameters.score
        noise = score.pixel_noise or estimate_pixel_noise(image)
        self._gain = self._calibrated_view_now.gain or most_gain(
            view.patch, view.footprint, pixel_noise=noise, map_contrast=self._map_contrast
        )
        weight = gramian(view.footprint, pixel_noise=noise, map_noise=self._map_noise)
        if score.metric.startswith('euclidean'):
            return view.valid * weight[view.valid].mean()
        return weight

    def _search(
        self, stamp_ns: int, match: Match, prior: Belief | None, *, everywhere: bool
    ) -> tuple[SearchResult | None, Verdict]:
        """Search about the prior, or everywhere, and judge; no earlier fix vouches for a first."""
        vouching = prior if self.track_state.confirmed else None
        judged = partial(judge, match, parameters=self.parameters, prior=vouching)
        if match.contrast < self.parameters.integrity.min_contrast:
            return None, judged(None)
        search = FrameSearch(
            match, self._crops, self._calibrated_view_now.refiner, self.parameters, self._map_noise
        )
        if everywhere or prior is None:
            self.track_state.searched(stamp_ns)
            found = search.everywhere(stamp_ns)
            return found, judged(found)
        if vouching is not None:
            near = search.near(vouching)
            verdict = judged(near)
            if verdict.status is Status.TRACKING:
                return near, verdict
        found = search.about(prior, fresh=self.track_state.fresh)
        return found, judged(found)

    @cached_property
    def _map_contrast(self) -> float:
        return contrast(self.raster_map.grey, self.raster_map.valid)

    @property
    def _map_noise(self) -> float:
        """Standard deviation of the map in the view's grey levels."""
        score = self.parameters.score
        return score.map_noise * (self._gain if score.normalized else 1.0)

    def _waiting(self, stamp_ns: int) -> Estimate:
        if self.track_state.wanted:
            return self._silent(stamp_ns, Status.LOST, (
                'not found on the map; the next search is due recovery.period '
                f'{self.parameters.recovery.period:g} s after the last'
            ))
        return self._silent(stamp_ns, Status.NO_PRIOR, (
            'no prior yet: publish initialpose, set initial_pose.*, or call ~/relocalize'
        ))

    def _conclude(
        self, stamp_ns: int, match: Match, found: SearchResult | None, verdict: Verdict,
        prior: Belief | None,
    ) -> Estimate:
        fit = verdict.fit
        match = replace(match, scores=found.scores if found else None, fit=fit)
        if verdict.status is not Status.TRACKING or fit is None:
            return self._missed(stamp_ns, verdict, match, prior)
        self._calibrated_view_now.gain = fit.gain
        belief = Belief(stamp_ns, fit.pose, fit.covariance_in_map)
        new_place = self.track_state.new_place(stamp_ns) or self._contradicts(prior, belief)
        self.track_state.fixed(new_place=new_place)
        if new_place:
            self.pose_filter.begin(belief)
        elif prior is not None:
            belief = self.pose_filter.correct(prior, belief, fuse=self.parameters.motion.fuse)
        wanted = self.track_state.unconfirmed
        if wanted > 0:
            verdict = Verdict(Status.CONFIRMING, (
                f'found on the map; {wanted} more agreeing frames are needed'
            ), fit, verdict.quality)
            return self._estimate(stamp_ns, verdict, match, None)
        return self._estimate(stamp_ns, verdict, match, belief)

    def _contradicts(self, prior: Belief | None, found: Belief) -> bool:
        """Whether a match is not where a vehicle can be that was at the place to be confirmed."""
        if self.track_state.unconfirmed == 0 or prior is None:
            return False
        return not self.pose_filter.follows(prior, found)

    def _missed(
        self, stamp_ns: int, verdict: Verdict, match: Match, prior: Belief | None
    ) -> Estimate:
        self.track_state.missed()
        if prior is not None:
            self.pose_filter.miss(prior)
        if self.track_state.lost:
            verdict = Verdict(Status.LOST, (
                f'{self.track_state.misses} frames without a fix; last: {verdict.status}, '
                f'{verdict.reason}'
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
