# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace
import json
import math
import os
from pathlib import Path
import subprocess
import sys
import zipfile

from evo.core import metrics as evo_metrics
from evo.core import sync
from evo.tools import file_interface
import numpy as np
import pytest
from run_samples import EPOCH, Frame, noisy_run, STEP
from scipy.stats import chi2

from gip_localizer.core.pose import Pose2
from gip_localizer.evaluation.error_table import ELLIPSE_95, tabulate_errors
from gip_localizer.evaluation.metrics import compute_metrics, format_table, table_rows
from gip_localizer.evaluation.results import write_results
from gip_localizer.io.trajectory import Trajectory

ERROR_KEYS = (
    'rmse_xy_m', 'rmse_lateral_m', 'rmse_longitudinal_m', 'rmse_yaw_deg', 'median_xy_m',
    'p95_xy_m', 'max_xy_m', 'wrong_published', 'nees_mean',
)


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp('evo') / 'run'
    return out, write_results(out, noisy_run(withheld=4))


def evo_statistics(out, relation, max_diff=1e-4):
    truth = file_interface.read_tum_trajectory_file(out / 'ground_truth.tum')
    estimate = file_interface.read_tum_trajectory_file(out / 'estimate.tum')
    matched = sync.associate_trajectories(truth, estimate, max_diff=max_diff)
    ape = evo_metrics.APE(relation)
    ape.process_data(matched)
    return ape.get_all_statistics()


def test_position_errors_agree_with_evo(folder):
    out, metrics = folder
    evo = evo_statistics(out, evo_metrics.PoseRelation.translation_part)
    assert metrics['rmse_xy_m'] == pytest.approx(evo['rmse'], abs=1e-9)
    assert metrics['median_xy_m'] == pytest.approx(evo['median'], abs=1e-9)
    assert metrics['max_xy_m'] == pytest.approx(evo['max'], abs=1e-9)


def test_errors_agree_with_evo_where_the_truth_has_other_stamps(tmp_path):
    run = noisy_run()
    late = run.truth.stamps_ns[:-1] + STEP // 15  # less than the 10 ms that evo passes over
    around = [run.truth.stamps_ns[:1], late, run.truth.stamps_ns[-1:]]
    stamps = np.concatenate(around)
    metrics = write_results(
        tmp_path / 'out', replace(run, truth=Trajectory(stamps, run.truth.at(stamps)))
    )
    evo = evo_statistics(tmp_path / 'out', evo_metrics.PoseRelation.translation_part, 0.01)
    assert metrics['judged'] == len(run.estimates)
    assert metrics['rmse_xy_m'] == pytest.approx(evo['rmse'], abs=1e-9)


def test_yaw_errors_agree_with_evo(folder):
    out, metrics = folder
    evo = evo_statistics(out, evo_metrics.PoseRelation.rotation_angle_deg)
    assert metrics['rmse_yaw_deg'] == pytest.approx(evo['rmse'], abs=1e-9)
    assert metrics['max_yaw_deg'] == pytest.approx(evo['max'], abs=1e-9)


def test_the_command_evo_ape_agrees(folder, tmp_path):
    out, metrics = folder
    answer = tmp_path / 'ape.zip'
    done = subprocess.run(
        [Path(sys.executable).parent / 'evo_ape', 'tum', out / 'ground_truth.tum',
         out / 'estimate.tum', '--save_results', answer, '--t_max_diff', '0.0001'],
        capture_output=True, text=True, env={**os.environ, 'HOME': str(tmp_path)}, timeout=120,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    with zipfile.ZipFile(answer) as archive:
        evo = json.loads(archive.read('stats.json'))
    assert metrics['rmse_xy_m'] == pytest.approx(evo['rmse'], abs=1e-9)


def test_lateral_is_to_the_left_of_the_true_heading():
    truth = Trajectory.from_samples([(0, Pose2(1, 1, math.pi / 2))])
    table = tabulate_errors([Frame(0, Pose2(0.9, 1.3, math.pi / 2))], truth)
    np.testing.assert_allclose(table.body[0], [0.3, 0.1, 0.0], atol=1e-12)


def test_sigma_is_turned_into_the_vehicle_axes():
    truth = Trajectory.from_samples([(0, Pose2(0, 0, math.pi / 2))])
    frame = Frame(0, Pose2(0, 0, math.pi / 2), np.diag([0.01, 0.04, 0.0001]))
    np.testing.assert_allclose(tabulate_errors([frame], truth).sigma[0], [0.2, 0.1, 0.01])


def test_yaw_errors_wrap():
    truth = Trajectory.from_samples([(0, Pose2(0, 0, math.pi - 0.01))])
    metrics = compute_metrics(noisy_run(
        truth=truth, estimates=[Frame(0, Pose2(0, 0, -math.pi + 0.01))]
    ))
    assert metrics['rmse_yaw_deg'] == pytest.approx(math.degrees(0.02))
    assert metrics['wrong_published'] == 0


@pytest.mark.parametrize(('error', 'wrong'), [
    ((0.49, 0.0, 0.0), 0), ((0.51, 0.0, 0.0), 1), ((0.36, 0.36, 0.0), 1),
    ((0.0, 0.0, math.radians(1.9)), 0), ((0.0, 0.0, math.radians(-2.1)), 1),
])
def test_a_fix_is_wrong_beyond_half_a_metre_or_two_degrees(error, wrong):
    truth = Trajectory.from_samples([(0, Pose2(3, 4, 1))])
    frame = Frame(0, Pose2(3 + error[0], 4 + error[1], 1 + error[2]))
    assert compute_metrics(noisy_run(truth=truth, estimates=[frame]))['wrong_published'] == wrong


def test_truth_is_interpolated_at_the_image_stamps():
    truth = Trajectory.from_samples([(0, Pose2(0, 0, 0)), (STEP, Pose2(1, 0, 0))])
    metrics = compute_metrics(noisy_run(
        truth=truth, estimates=[Frame(STEP // 4, Pose2(0.25, 0.1, 0))]
    ))
    assert metrics['rmse_longitudinal_m'] == pytest.approx(0.0, abs=1e-12)
    assert metrics['rmse_lateral_m'] == pytest.approx(0.1)


def test_frames_outside_the_truth_are_not_judged():
    run = noisy_run(count=20)
    half = Trajectory(run.truth.stamps_ns[:10], run.truth.poses[:10])
    metrics = compute_metrics(noisy_run(count=20, truth=half))
    assert metrics['judged'] == 10
    assert metrics['published'] == 20


def test_without_truth_errors_are_null_and_counts_are_not():
    metrics = compute_metrics(noisy_run(truth=None, withheld=6))
    assert all(metrics[key] is None for key in ERROR_KEYS)
    assert (metrics['frames'], metrics['published'], metrics['rejected']) == (60, 54, 6)
    assert 'unknown' in format_table(table_rows(metrics))


def test_without_a_fix_errors_are_null_and_nothing_is_wrong():
    metrics = compute_metrics(noisy_run(count=5, withheld=5))
    assert all(metrics[key] is None for key in ERROR_KEYS if key != 'wrong_published')
    assert metrics['wrong_published'] == 0
    assert metrics['availability'] == 0.0
    assert metrics['time_to_first_fix_s'] is None


def test_a_run_without_frames_is_valid():
    metrics = compute_metrics(noisy_run(estimates=[]))
    assert metrics['frames'] == 0
    assert metrics['availability'] is None
    assert metrics['latency_ms'] == {'p50': None, 'p95': None, 'p99': None, 'stages': {}}


def test_time_to_first_fix_is_counted_from_the_first_frame():
    metrics = compute_metrics(noisy_run(withheld=3))
    assert metrics['time_to_first_fix_s'] == pytest.approx(0.3)
    assert metrics['statuses'] == {'LOST': 3, 'TRACKING': 57}


def test_latency_is_the_total_not_the_sum_with_it():
    frames = [Frame(EPOCH + i, None, timings_ms={'a': 1.0, 'total': 5.0}) for i in range(3)]
    metrics = compute_metrics(noisy_run(estimates=frames))
    assert metrics['latency_ms']['p50'] == 5.0
    assert metrics['latency_ms']['stages'] == {'a': {'p50': 1.0, 'p95': 1.0, 'p99': 1.0}}
    assert metrics['frames_per_second'] == pytest.approx(1.5)


@pytest.mark.parametrize(('scale', 'expected'), [(1.0, 3.0), (2.0, 12.0), (0.5, 0.75)])
def test_nees_tells_honest_from_vain_and_shy(scale, expected):
    count = 3000
    metrics = compute_metrics(noisy_run(count=count, scale=scale))
    spread = expected * math.sqrt(2.0 * 3.0 / count) / math.sqrt(3.0)
    assert metrics['nees_mean'] == pytest.approx(expected, abs=5.0 * spread)
    inside = chi2.cdf(ELLIPSE_95 / scale**2, 2)
    assert metrics['coverage_95'] == pytest.approx(inside, abs=0.02)


def test_a_singular_covariance_has_no_nees():
    truth = Trajectory.from_samples([(0, Pose2(0, 0, 0))])
    table = tabulate_errors([Frame(0, Pose2(0, 0, 0), np.zeros((3, 3)))], truth)
    assert np.isnan(table.nees).all()


def test_the_figures_are_json_and_hold_the_configuration():
    metrics = compute_metrics(noisy_run())
    read = json.loads(json.dumps(metrics, allow_nan=False))
    assert read['config']['bag'] == 'bags/demo'
    assert read['config']['parameters']['score.metric'] == 'gip_normalized'
