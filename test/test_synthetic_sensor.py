# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""Laws of the sensor: exposure, shading, noise variance, quantization, seeds."""

from __future__ import annotations

import numpy as np
import pytest

from gip_localizer.synthetic.sensor import SensorModel, vignetting_factor

FLAT = np.full((400, 500), 0.4, np.float32)


@pytest.mark.parametrize(
    ('full_well', 'read_noise'), [(0.0, 0.02), (2000.0, 0.0), (1000.0, 0.01)]
)
@pytest.mark.parametrize('level', [0.1, 0.6])
def test_noise_variance_follows_the_law(full_well, read_noise, level):
    sensor = SensorModel(full_well=full_well, read_noise=read_noise, bits=16)
    values = sensor.capture(np.full_like(FLAT, level), 0, 0) / 65535.0
    shot = level / full_well if full_well else 0.0
    # 200,000 samples: the variance's own relative error is √(2/n) = 0.3 %.
    assert values.var() == pytest.approx(shot + read_noise**2, rel=0.015)
    assert values.mean() == pytest.approx(level, abs=5e-4)


def test_noise_is_white():
    noise = SensorModel(read_noise=0.05, bits=16).capture(FLAT, 1, 2) / 65535.0 - 0.4
    for neighbour in (noise[1:] * noise[:-1], noise[:, 1:] * noise[:, :-1]):
        assert abs(neighbour.mean()) / noise.var() < 0.01
    assert abs((noise**3).mean()) / noise.std() ** 3 < 0.03


def test_exposure_is_gain_and_offset():
    image = SensorModel(gain=1.5, offset=0.11).capture(FLAT, 0, 0)
    assert np.all(image == round(255 * 0.71))


def test_clipping():
    assert np.all(SensorModel(gain=5.0).capture(FLAT, 0, 0) == 255)
    assert np.all(SensorModel(offset=-0.9).capture(FLAT, 0, 0) == 0)


def test_vignetting_darkens_the_corners_only():
    light = vignetting_factor((101, 201), 0.3)
    assert light[50, 100] == pytest.approx(1.0)
    assert light[0, 0] == pytest.approx(0.7)
    assert light[100, 200] == pytest.approx(0.7)
    assert np.all(light[50, :] >= light[0, :])


def test_sixteen_bits_resolve_what_eight_cannot():
    ramp = np.linspace(0.5, 0.5 + 1 / 255, 256, dtype=np.float32)[None]
    assert len(np.unique(SensorModel(bits=8).capture(ramp, 0, 0))) <= 2
    assert len(np.unique(SensorModel(bits=16).capture(ramp, 0, 0))) > 200


def test_a_frame_is_made_again_alone():
    sensor = SensorModel(full_well=5000.0, read_noise=0.01)
    frames = [sensor.capture(FLAT, 3, k).tobytes() for k in range(3)]
    assert sensor.capture(FLAT, 3, 2).tobytes() == frames[2]
    assert len(set(frames)) == 3
    assert sensor.capture(FLAT, 4, 2).tobytes() != frames[2]


def test_the_scene_stays_untouched():
    scene = FLAT.copy()
    SensorModel(gain=2.0, offset=0.1, vignetting=0.2, read_noise=0.1).capture(scene, 0, 0)
    assert np.array_equal(scene, FLAT)


def test_other_depths_are_refused():
    with pytest.raises(ValueError, match='12'):
        SensorModel(bits=12)
