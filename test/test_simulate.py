# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import asdict

from drive_samples import ROUGH, SMALL
import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from scipy.spatial.transform import Rotation

from gip_localizer.cli import main
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.io.bags.bag import Bag
from gip_localizer.io.images import compressed_grey_image, grey_image
from gip_localizer.io.map_files import load_map
from gip_localizer.io.messages import calibration, planar_pose, stamp_ns
from gip_localizer.parameters import load_parameter_file
from gip_localizer.parameters.ros_yaml import load_ros_yaml
from gip_localizer.synthetic.parameters import SyntheticCameraParameters
from gip_localizer.synthetic.scenarios import SCENARIOS

TOPICS = {
    '/camera_info': 'sensor_msgs/msg/CameraInfo', '/ground_truth': 'geometry_msgs/msg/PoseStamped',
    '/image': 'sensor_msgs/msg/Image', '/odom': 'nav_msgs/msg/Odometry',
    '/tf_static': 'tf2_msgs/msg/TFMessage',
}


def simulate(out, *options):
    assert main(['simulate', '--out', str(out), *options]) == 0
    return out


def decoded(folder, topic):
    bag = Bag([folder])
    return [bag.decode(message) for message in bag.messages([topic])]


def test_the_bag_is_a_rosbag2_folder(drive):
    with Reader(drive) as reader:
        found = {c.topic: (c.msgtype, c.msgcount) for c in reader.connections}
    assert {topic: kind for topic, (kind, _) in found.items()} == TOPICS
    counts = {topic: count for topic, (_, count) in found.items()}
    assert counts['/image'] == counts['/camera_info'] == counts['/ground_truth'] == 25
    assert counts['/odom'] >= 120
    assert counts['/tf_static'] == 1


def test_map_and_parameters_lie_beside_the_bag(drive):
    assert load_map(drive / 'map.yaml').grey.size > 100_000
    parameters = load_parameter_file(drive / 'params.yaml')
    assert parameters.initial_pose.set
    read = SyntheticCameraParameters.from_dict(load_ros_yaml(drive / 'synthetic_camera.yaml'))
    assert read.lens.width == 640
    held = asdict(parameters.camera)
    assert held.pop('from_tf') is False
    assert held.pop('sigma_yaw') == 0.0
    assert asdict(read.camera) == held


def test_the_prior_is_near_the_truth_but_is_not_the_truth(drive):
    start = planar_pose(decoded(drive, '/ground_truth')[0].pose)
    prior = load_parameter_file(drive / 'params.yaml').initial_pose
    away = np.hypot(prior.x - start.x, prior.y - start.y)
    assert 0.001 < away < 2.0 * np.sqrt(2.0) * prior.sigma_xy + 0.001
    assert abs(prior.yaw - start.yaw) <= 2.0 * prior.sigma_yaw + 1e-4


def test_stamps_of_a_frame_agree(drive):
    stamps = [[stamp_ns(m.header) for m in decoded(drive, topic)]
              for topic in ('/image', '/camera_info', '/ground_truth')]
    assert stamps[0] == stamps[1] == stamps[2]
    assert set(np.diff(stamps[0])) == {100_000_000}


def test_static_transform_is_the_camera_s_pose(tmp_path):
    out = simulate(tmp_path / 'out', '--seconds', '0.1', *SMALL, *ROUGH,
                   '--set', 'camera.roll=0.1',
                   '--set', 'camera.yaw=-0.2', '--set', 'camera.x=1.5')
    stamped = decoded(out, '/tf_static')[0].transforms[0]
    camera = load_parameter_file(out / 'params.yaml').camera
    held = Extrinsics(camera.x, camera.y, camera.z, camera.roll, camera.pitch, camera.yaw)
    q = stamped.transform.rotation
    np.testing.assert_allclose(
        Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix(), held.rotation(), atol=1e-12
    )
    assert stamped.transform.translation.x == 1.5
    assert stamped.header.frame_id == 'base_link'
    assert stamped.child_frame_id == decoded(out, '/image')[0].header.frame_id


def test_the_same_seed_gives_the_same_bytes_whatever_the_folder(tmp_path):
    one, two, other = (
        simulate(tmp_path / name, '--seconds', '0.3', '--seed', seed, *SMALL, *ROUGH)
        for name, seed in (('one', '3'), ('elsewhere', '3'), ('other', '4'))
    )
    for file in sorted(one.iterdir()):
        assert file.read_bytes() == (two / file.name).read_bytes(), file.name
    assert (one / 'drive.mcap').read_bytes() != (other / 'drive.mcap').read_bytes()


@pytest.mark.parametrize('transport', ['jpeg', 'png'])
def test_compressed_images_are_the_raw_ones(tmp_path, transport):
    how = ['--seconds', '0.2', *SMALL, *ROUGH]
    out = simulate(tmp_path / 'out', '--transport', transport, *how)
    drive = simulate(tmp_path / 'raw', *how)
    assert load_parameter_file(out / 'params.yaml').image_transport == 'compressed'
    raw = grey_image(decoded(drive, '/image')[0]).astype(float)
    seen = compressed_grey_image(decoded(out, '/image/compressed')[0]).astype(float)
    assert np.abs(raw - seen).mean() <= (0.0 if transport == 'png' else 2.5)


def test_sixteen_bits_survive(tmp_path):
    out = simulate(tmp_path / 'out', '--seconds', '0.1', *SMALL, *ROUGH, '--set',
                   'sensor.bits=16')
    message = decoded(out, '/image')[0]
    assert message.encoding == 'mono16'
    image = grey_image(message)
    assert image.dtype == np.uint16
    assert image.max() > 20_000


@pytest.mark.parametrize('scenario', sorted(SCENARIOS))
def test_every_scenario_is_recorded_with_a_view_that_its_camera_sees(tmp_path, scenario):
    own_lens = any(name.startswith('lens.') for name in SCENARIOS[scenario])
    lens = [] if own_lens else SMALL
    out = simulate(tmp_path / 'out', '--scenario', scenario, '--seconds', '0.1', *lens, *ROUGH)
    parameters = load_parameter_file(out / 'params.yaml')
    info = calibration(decoded(out, '/camera_info')[0])
    settings = SyntheticCameraParameters.from_dict(load_ros_yaml(out / 'synthetic_camera.yaml'))
    for name, value in SCENARIOS[scenario].items():
        assert settings.to_dict()[name] == value
    image = grey_image(decoded(out, '/image')[0])
    assert image.shape == (info.height, info.width)
    assert parameters.birdseye.far > parameters.birdseye.near
