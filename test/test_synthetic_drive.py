# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Drives: frames, truth and odometry that belong together and can be made again."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from gip_localizer.core.pose import Pose2
from gip_localizer.errors import MapError, ParameterError
from gip_localizer.io.map_files import save_map
from gip_localizer.synthetic.drive import SyntheticDrive
from gip_localizer.synthetic.motions import LineMotion
from gip_localizer.synthetic.parameters import Odometry, SyntheticCameraParameters
from gip_localizer.synthetic.scenarios import scenario_parameters, SCENARIOS
from gip_localizer.synthetic.wheel_odometry import odometry_readings

SMALL = {
    'lens.width': 160, 'lens.height': 90, 'lens.focal': 112.5, 'world.resolution': 0.1,
    'world.join': 1,
}


def small_drive(name='clear', **more):
    values = {key.replace('__', '.'): value for key, value in more.items()}
    return SyntheticDrive(scenario_parameters(name, {**SMALL, **values}), start_ns=5_000)


@pytest.mark.parametrize('name', SCENARIOS)
def test_every_scenario_renders_and_renders_again(name):
    first, again = small_drive(name).frame(3), small_drive(name).frame(3)
    assert first.image.tobytes() == again.image.tobytes()
    assert first.truth == again.truth
    assert first.image.dtype == np.uint8
    assert first.image.std() > 2.0


def test_a_frame_does_not_depend_on_those_before():
    drive = small_drive('occlusion', disturbance__pitch=0.01)
    in_order = [frame.image.tobytes() for frame in itertools.islice(drive.frames(), 4)]
    alone = small_drive('occlusion', disturbance__pitch=0.01).frame(3)
    assert alone.image.tobytes() == in_order[3]
    assert len(set(in_order)) == 4


def test_seed_changes_noise_but_not_the_world_or_the_way():
    one, two = small_drive(seed=1), small_drive(seed=2)
    assert one.frame(2).image.tobytes() != two.frame(2).image.tobytes()
    assert one.truth(2) == two.truth(2)
    assert np.array_equal(one.raster_map.grey, two.raster_map.grey)


def test_frames_come_at_the_rate_along_the_lane():
    drive = small_drive(rate=4.0, drive__speed=6.0)
    frames = list(drive.frames(2.0))
    assert [frame.stamp_ns for frame in frames] == [5_000 + k * 250_000_000 for k in range(8)]
    steps = np.diff(np.array([frame.truth[:2] for frame in frames]), axis=0)
    assert np.allclose(np.linalg.norm(steps, axis=1), 1.5, rtol=0.01)


def test_night_is_dark_and_the_occluded_view_a_quarter_hidden():
    assert small_drive('night').frame(0).image.mean() <= 25.0
    hidden = small_drive('occlusion').frame(0).hidden
    assert 0.1 < hidden.mean() < 0.5
    assert small_drive('clear').frame(0).hidden is None


def test_pitch_swings_within_its_amplitude_and_unseen_by_the_calibration():
    drive = small_drive('pitch-bumps')
    pitches = np.array([
        drive.synthetic_camera.extrinsics_at(t).pitch for t in np.arange(0.0, 10.0, 0.01)
    ]) - drive.camera.extrinsics.pitch
    amplitude = math.radians(0.7)
    assert pitches.max() == pytest.approx(amplitude, rel=0.01)
    assert pitches.min() == pytest.approx(-amplitude, rel=0.01)
    assert drive.camera.extrinsics.pitch == pytest.approx(math.radians(15.0))


def test_changed_world_is_not_what_the_map_shows():
    before, after = small_drive('clear'), small_drive('changed')
    assert np.array_equal(before.raster_map.grey, after.raster_map.grey)
    different = before.frame(0).image.astype(int) - after.frame(0).image
    assert np.abs(different).mean() > 1.0


def test_motion_smears_the_image():
    still = small_drive(drive__speed=0.0, sensor__exposure_time=0.1, sensor__read_noise=0.0,
                        sensor__full_well=0.0)
    fast = small_drive(drive__speed=10.0, sensor__exposure_time=0.1, sensor__read_noise=0.0,
                       sensor__full_well=0.0)
    rows = slice(60, 90)
    sharp, smeared = (np.diff(d.frame(0).image[rows].astype(float), axis=0).std()
                      for d in (still, fast))
    assert smeared < 0.6 * sharp


def test_map_file_is_a_world(tmp_path):
    save_map(small_drive('tiles-low-snr').raster_map, tmp_path / 'map.yaml')
    drive = small_drive(world__name=str(tmp_path / 'map.yaml'))
    assert drive.frame(0).image.std() > 5.0
    assert drive.world.raster.contains(np.array([drive.truth(k)[:2] for k in range(50)])).all()
    with pytest.raises(MapError, match='nothing'):
        small_drive(world__name=str(tmp_path / 'nothing.yaml'))


def test_events_are_in_order_and_complete():
    drive = small_drive(rate=5.0, odometry__rate=20.0)
    events = list(drive.events(1.0))
    stamps = [getattr(e, 'stamp_ns', None) or e.sample.stamp_ns for e in events]
    assert stamps == sorted(stamps)
    assert sum(hasattr(e, 'image') for e in events) == 5
    assert len(events) == 5 + 17


def final_errors(settings, distance, runs):
    motion = LineMotion(Pose2(3.0, -2.0, 0.8), 5.0)
    count = round(distance / 5.0 * settings.rate)
    errors = []
    for seed in range(runs):
        readings = odometry_readings(motion, settings, seed=seed, start_ns=0)
        last = next(itertools.islice(readings, count, None))
        errors.append(np.array(last.sample.pose) - [distance, 0.0, 0.0])
    return np.array(errors), last.pose_covariance


def test_perfect_odometry_is_the_motion_seen_from_its_start():
    exact = Odometry(noise_xy=0.0, noise_yaw=0.0, scale_error=0.0, yaw_drift=0.0, rate=20.0)
    errors, _ = final_errors(exact, 20.0, 1)
    assert np.allclose(errors, 0.0, atol=1e-9)


@pytest.mark.parametrize('rate', [10.0, 40.0])
def test_drift_grows_with_the_distance_whatever_the_rate(rate):
    settings = Odometry(noise_xy=0.02, noise_yaw=0.002, scale_error=0.01, yaw_drift=0.0, rate=rate)
    errors, covariance = final_errors(settings, 25.0, 300)
    assert errors[:, 0].mean() == pytest.approx(0.25, abs=0.03)
    # 300 runs: the standard deviation's own relative error is 4 %; 4 of its sigmas allowed.
    assert errors[:, 0].std() == pytest.approx(0.02 * 5.0, rel=0.17)
    assert errors[:, 2].std() == pytest.approx(0.002 * 5.0, rel=0.17)
    assert covariance[2, 2] == pytest.approx((0.002 * 5.0) ** 2, rel=0.01)


def test_steady_yaw_drift_bends_the_way():
    settings = Odometry(noise_xy=0.0, noise_yaw=0.0, scale_error=0.0, yaw_drift=0.01, rate=20.0)
    errors, _ = final_errors(settings, 10.0, 1)
    assert errors[0, 2] == pytest.approx(0.1, rel=1e-6)
    assert errors[0, 1] == pytest.approx(0.5, rel=0.02)


def test_bad_settings_are_refused():
    with pytest.raises(ParameterError, match='scenario'):
        scenario_parameters('fog')
    with pytest.raises(ParameterError, match=r'sensor\.bits'):
        scenario_parameters('clear', {'sensor.bits': 12})
    with pytest.raises(ParameterError, match=r'lens\.focal'):
        SyntheticCameraParameters.from_dict({'lens.focal': -1.0})
