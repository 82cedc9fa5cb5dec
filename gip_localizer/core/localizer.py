# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""
The localizer: one frame in, one estimate out.

`Localizer.update` is the data flow: 1 bird's-eye view, 2 Gramian, 3 scores, 4 posterior.

"""

from __future__ import annotations

from dataclasses import replace

from gip_localizer.core import track_verdicts
from gip_localizer.core.arrays import Floats, Grey
from gip_localizer.core.belief import Belief, checked_prior
from gip_localizer.core.birdseye.rectifier import View
from gip_localizer.core.birdseye.weights import cell_weights, noise_levels, NoiseLevels
from gip_localizer.core.calibrated_view import CalibratedView
from gip_localizer.core.camera.image_check import image_fault
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.estimate import Estimate, Match, Status
from gip_localizer.core.integrity import Verdict
from gip_localizer.core.judged_search import JudgedSearch
from gip_localizer.core.map.raster_map import RasterMap
from gip_localizer.core.pose import Pose2
from gip_localizer.core.protection import protection_figures
from gip_localizer.core.refine.observation import FrameErrors
from gip_localizer.core.search.frame_search import FrameSearch
from gip_localizer.core.search.map_crops import MapCrops
from gip_localizer.core.stage_times import StageTimes
from gip_localizer.core.track.odometry import OdometrySample
from gip_localizer.core.track.track_state import TrackState
from gip_localizer.errors import CalibrationError
from gip_localizer.parameters import Parameters


class Localizer:
    """
    Matches camera frames against a map.

    Parameters
    ----------
    raster_map : RasterMap
        The map of the road.
    parameters : Parameters
        All tunables; replace them between frames with `configure`.

    Attributes
    ----------
    state : TrackState
        State of the drive that is kept from frame to frame.

    """

    def __init__(self, raster_map: RasterMap, parameters: Parameters) -> None:
        self.raster_map = raster_map
        self.parameters = parameters
        self.state = TrackState(parameters)
        self._crops = MapCrops(raster_map)
        self._prepared: CalibratedView | None = None
        self._times = StageTimes()

    def configure(self, parameters: Parameters) -> None:
        """Use new parameters from the next frame on; the belief stays."""
        self.parameters = parameters
        self.state.configure(parameters)

    def change_map(self, raster_map: RasterMap) -> None:
        """Localize on another map from the next frame on; the state of the drive stays."""
        self.raster_map = raster_map
        self._crops = MapCrops(raster_map)

    def set_prior(self, stamp_ns: int, pose: Pose2, covariance: Floats) -> None:
        """
        Start again from an initial pose.

        Parameters
        ----------
        stamp_ns : int
            Stamp of the pose, nanoseconds; 0: now. A stamp long before the last frame is of
            another clock and also means now.
        pose : Pose2
            Pose of base in map.
        covariance : (3, 3) float64
            Covariance of x, y (m) and yaw (rad), map axes.

        Raises
        ------
        PriorError
            NaN or a covariance that is not positive definite; the belief stays as it was.

        """
        self.state.start_from(checked_prior(stamp_ns, pose, covariance))

    @property
    def prepared(self) -> CalibratedView | None:
        """What is precomputed for the last camera; None if it cannot be used."""
        return self._prepared

    def view_fits(self, camera: CameraModel) -> bool:
        """Return whether the view is computed for a camera, the parameters and the map."""
        raster_map = self.raster_map
        return self._prepared is not None and self._prepared.matches(
            camera, self.parameters, raster_map.resolution, raster_map.accuracy
        )

    def prepare(self, camera: CameraModel) -> None:
        """Precompute what a camera needs before its first frame."""
        self._prepare(0, camera)

    def add_odometry(self, sample: OdometrySample) -> bool:
        """Add an odometry sample; return False if it is refused."""
        return self.state.pose_filter.odometry.add(sample)

    def relocalize(self) -> None:
        """Search the whole map from the next frame on, until the place is found."""
        self.state.request_search()

    def searches(self, stamp_ns: int) -> bool:
        """Return whether `update` would search the whole map for a frame, which takes seconds."""
        return self.state.search_due(stamp_ns)

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
            Pixels below half of full scale are ignored (the bonnet, other cars).

        Returns
        -------
        Estimate
            A pose with covariance, or the reason why there is none.

        """
        self._times = StageTimes()
        prepared = self._checked(stamp_ns, image, camera, mask)
        if isinstance(prepared, Estimate):
            return prepared
        prior = self.state.predict(stamp_ns)
        if prior is None and not self.state.search_due(stamp_ns):
            waiting = track_verdicts.without_search(self.state, self.parameters.recovery)
            return self._without_pose(stamp_ns, waiting.status, waiting.reason)

        with self._times.stage('birdseye'):  # 1 mean per cell
            view = prepared.rectifier.rectify(image)

        with self._times.stage('gramian'):  # 2 weight per cell
            match, noise = self._weighed(view, image, prepared, mask)

        with self._times.stage('match'):  # 3 score per candidate, best modes refined, judged
            search = self._judged_search(match, noise, prepared)
            found, verdict = search.best(stamp_ns, prior)

        with self._times.stage('posterior'):  # 4 belief, or a reason why there is no pose
            match = replace(match, scores=found.scores if found else None, fit=verdict.fit)
            return self._update_track(stamp_ns, match, verdict, prior)

    def _checked(
        self, stamp_ns: int, image: Grey, camera: CameraModel, mask: Grey | None
    ) -> CalibratedView | Estimate:
        """Return what is precomputed for the camera, or why the frame cannot be used."""
        if fault := image_fault(image, mask, camera):
            return self._without_pose(stamp_ns, Status.BAD_IMAGE, fault)
        if fault := self.state.take_stamp(stamp_ns):
            return self._without_pose(stamp_ns, Status.OUT_OF_ORDER, fault)
        return self._prepare(stamp_ns, camera)

    def _weighed(
        self, view: View, image: Grey, prepared: CalibratedView, mask: Grey | None
    ) -> tuple[Match, NoiseLevels]:
        """Return the view with the weight (rows, cols) of each cell, and the frame's noise."""
        score = self.parameters.score
        noise = noise_levels(
            view, image, score, gain=self.state.gain, map_contrast=self.raster_map.contrast
        )
        weight = cell_weights(view, noise, score)
        if mask is not None:
            weight = weight * prepared.rectifier.unmasked(mask)
        return Match(view, weight), noise

    def _judged_search(
        self, match: Match, noise: NoiseLevels, prepared: CalibratedView
    ) -> JudgedSearch:
        search = FrameSearch(
            match=match, crops=self._crops, refiner=prepared.refiner, parameters=self.parameters,
            errors=FrameErrors(noise.map, self.state.error_level),
        )
        return JudgedSearch(search, self.state, self.parameters)

    def _prepare(self, stamp_ns: int, camera: CameraModel) -> CalibratedView | Estimate:
        """Return what is precomputed for a camera, or why its frame cannot be used."""
        try:
            with self._times.stage('calibrate'):
                if not self.view_fits(camera):
                    shown = self.raster_map.resolution, self.raster_map.accuracy
                    self._prepared = CalibratedView(camera, self.parameters, *shown)
                    self.state.forget_calibration()
        except CalibrationError as error:
            self._prepared = None
            return self._without_pose(stamp_ns, Status.NO_ROAD_IN_VIEW, str(error))
        assert self._prepared is not None
        return self._prepared

    def _update_track(
        self, stamp_ns: int, match: Match, verdict: Verdict, prior: Belief | None
    ) -> Estimate:
        fit = verdict.fit
        if verdict.status is not Status.TRACKING or fit is None:
            self.state.miss(prior)
            return self._estimate(stamp_ns, track_verdicts.of_miss(self.state, verdict), match)
        measured = Belief(stamp_ns, fit.pose, fit.covariance_in_map, shared=fit.shared_in_map)
        belief = self.state.accept(prior, measured, gain=fit.gain, error_level=fit.shared.level)
        verdict = track_verdicts.of_fix(self.state, verdict)
        confirmed = verdict.status is Status.TRACKING
        return self._estimate(stamp_ns, verdict, match, belief if confirmed else None)

    def _without_pose(self, stamp_ns: int, status: Status, reason: str) -> Estimate:
        return Estimate(stamp_ns, status, reason, timings_ms=dict(self._times.milliseconds))

    def _estimate(
        self, stamp_ns: int, verdict: Verdict, match: Match, belief: Belief | None = None
    ) -> Estimate:
        return Estimate(
            stamp_ns=stamp_ns, status=verdict.status, reason=verdict.reason,
            pose=belief.pose if belief else None,
            covariance=belief.covariance if belief else None,
            quality={**verdict.quality, **self._protection(belief)},
            timings_ms=self._times.milliseconds, match=match,
        )

    def _protection(self, belief: Belief | None) -> dict[str, float]:
        if belief is None or self._prepared is None:
            return {}
        return protection_figures(
            belief.covariance, belief.pose, self._prepared.refiner.constant_errors,
            self.parameters.integrity,
        )
