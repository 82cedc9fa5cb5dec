# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`frames.csv`, and what the mean of the camera's motion says of the calibration."""

from __future__ import annotations

import csv
from dataclasses import replace
from io import StringIO

import numpy as np
import pytest
from run_samples import EPOCH, noisy_run

from gip_localizer.evaluation.camera_motion import correction_notes, corrections
from gip_localizer.evaluation.error_table import tabulate_errors
from gip_localizer.evaluation.frame_table import frame_table
from gip_localizer.evaluation.metrics import compute_metrics
from gip_localizer.parameters import Parameters


def rows_of(run):
    text = frame_table(run, tabulate_errors(run.estimates, run.truth))
    return list(csv.DictReader(StringIO(text)))


def test_there_is_one_row_per_frame_with_what_is_known():
    run = noisy_run(withheld=2)
    rows, table = rows_of(run), tabulate_errors(run.estimates, run.truth)
    assert [row['frame'] for row in rows] == [str(n + 1) for n in range(60)]
    assert rows[0]['stamp'] == f'{EPOCH // 10**9}.000000000'
    assert (rows[0]['status'], rows[0]['reason'], rows[0]['x_m']) == ('LOST', 'no match', '')
    assert (rows[0]['nees'], rows[0]['total_ms'], rows[0]['quality.correlation']) == ('', '', '')
    last = rows[-1]
    assert float(last['x_m']) == pytest.approx(run.estimates[-1].pose.x, abs=1e-6)
    assert float(last['error_lateral_m']) == pytest.approx(table.body[-1, 1], abs=1e-6)
    assert float(last['sigma_yaw_rad']) == pytest.approx(table.sigma[-1, 2], abs=1e-6)
    assert float(last['nees']) == pytest.approx(table.nees[-1], abs=1e-6)
    assert (last['birdseye_ms'], last['quality.correlation']) == ('2.000', '0.9')


def test_a_reason_with_commas_and_quotes_is_one_cell():
    run = noisy_run(count=3)
    frames = [replace(run.estimates[0], reason='a "b", c\nd'), *run.estimates[1:]]
    assert rows_of(replace(run, estimates=frames))[0]['reason'] == 'a "b", c\nd'


def test_a_figure_named_like_a_column_does_not_replace_it():
    run = noisy_run(count=3)
    frames = [replace(frame, quality={'sigma_yaw_rad': 7.0}) for frame in run.estimates]
    row = rows_of(replace(run, estimates=frames))[0]
    assert float(row['sigma_yaw_rad']) < 1.0
    assert row['quality.sigma_yaw_rad'] == '7'


def test_without_truth_or_frames_the_table_is_valid():
    assert {row['error_yaw_rad'] for row in rows_of(noisy_run(truth=None))} == {''}
    assert rows_of(noisy_run(estimates=[])) == []


def moved(mean, spread, name='pitch_rad', count=40):
    values = mean + spread * np.random.default_rng(3).standard_normal(count)
    run = noisy_run(count=count)
    return [replace(frame, quality={name: float(value), 'gain': 1.1})
            for frame, value in zip(run.estimates, values, strict=True)]


@pytest.mark.parametrize(('frames', 'expected'), [
    (moved(0.006, 0.001), {'camera.pitch': 0.306}),
    (moved(-0.02, 0.001, 'height_m'), {'camera.z': 1.48}),
    (moved(0.001, 0.0003), {}),  # small against the prior
    (moved(0.006, 0.02), {}),  # a suspension that moves
])
def test_a_mean_beyond_prior_and_motion_is_an_error_of_the_calibration(frames, expected):
    given = Parameters.from_dict({'camera.pitch': 0.3, 'camera.z': 1.5})
    found = corrections(frames, given)
    assert found == pytest.approx(expected, abs=1e-3)
    notes = correction_notes(frames, given)
    assert [name in note for note in notes for name in expected] == [True] * len(expected)


def test_the_means_are_metrics():
    run = noisy_run(count=40)
    frames = moved(0.006, 0.001)
    metrics = compute_metrics(replace(run, estimates=frames))
    assert metrics['camera_motion']['pitch_deg'] == pytest.approx(0.344, abs=0.02)
    assert metrics['camera_motion']['gain'] == pytest.approx(1.1)
    assert metrics['camera_motion']['roll_deg'] is None
    assert list(metrics['corrections']) == ['camera.pitch']
