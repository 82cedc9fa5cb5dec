# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""With the pose of the camera, K and the map alone, each kind of vehicle gets exact poses."""

import math
from pathlib import Path

import numpy as np
import pytest
from road_samples import Road

from gip_localizer.core.camera.calibration import Calibration
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.core.camera.model import CameraModel
from gip_localizer.core.localizer import Localizer
from gip_localizer.core.pose import Pose2
from gip_localizer.parameters import load_parameter_file, Parameters

FRAMES = 5
START = np.diag([0.15**2, 0.15**2, 0.02**2])
LEAST_PUBLISHED = 0.95  # of the frames


def camera(width, height, focal, **held):
    K = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0, 0, 1]])
    return CameraModel(Calibration(width, height, K), Extrinsics(**held))


LENSES = {
    'car': (1280, 720, 900.0), 'small_robot': (640, 480, 600.0), 'truck': (1280, 720, 900.0),
    'nadir': (1280, 720, 700.0),
}
PRESETS = Path(__file__).parents[1] / 'config' / 'presets'


def preset(name):
    """Return the camera of a preset, and its parameters."""
    parameters = load_parameter_file(PRESETS / f'{name}.yaml')
    held = parameters.camera
    return camera(*LENSES[name], x=held.x, z=held.z, pitch=held.pitch), parameters


def test_each_preset_is_a_parameter_file_whose_view_is_automatic():
    files = sorted(path.stem for path in PRESETS.glob('*.yaml'))
    assert files == sorted([*LENSES, 'fisheye'])
    for name in files:
        assert len(load_parameter_file(PRESETS / f'{name}.yaml').birdseye.automatic) == 4


@pytest.fixture(scope='module')
def road():
    return Road(size=(64.0, 48.0))  # a truck's view reaches 20 m ahead


@pytest.mark.parametrize('name', LENSES)
@pytest.mark.parametrize('given', ['defaults', 'preset'])
def test_defaults_and_presets_give_poses_within_a_tenth_of_a_cell(road, name, given):
    (device, parameters), rng = preset(name), np.random.default_rng(11)
    localizer = Localizer(road.map, Parameters() if given == 'defaults' else parameters)
    errors = []
    for index, share in enumerate(np.linspace(0.3, 0.6, FRAMES)):
        truth, stamp = road.pose(share), (index + 1) * 10**9
        start = truth @ Pose2(*rng.uniform(-1.0, 1.0, 3) * (0.15, 0.15, 0.02))
        localizer.set_prior(stamp, start, START)
        found = localizer.update(stamp, road.frame(device, truth, seed=index), device)
        if found.pose is not None:
            errors.append(math.hypot(found.pose.x - truth.x, found.pose.y - truth.y))
    assert len(errors) >= LEAST_PUBLISHED * FRAMES
    rms = math.sqrt(float(np.mean(np.square(errors))))
    assert rms <= 0.1 * road.map.resolution
