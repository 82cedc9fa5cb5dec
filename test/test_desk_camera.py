# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""A vehicle's own parameter file at the desk: the camera is where /tf_static of the bag has it."""

from __future__ import annotations

from bag_samples import IMAGE
from drive_samples import recorded, replayed, rewritten
import pytest
from scipy.spatial.transform import Rotation

from gip_localizer.cli import main
from gip_localizer.core.camera.extrinsics import Extrinsics
from gip_localizer.io.bags.writer import make, make_header
from gip_localizer.io.cdr import jazzy
from gip_localizer.parameters import load_parameter_file

TF = 'tf2_msgs/msg/TFMessage'
FROM_TF = ['--set', 'camera.from_tf=true']
ELSEWHERE = ['--set', 'camera.x=3', '--set', 'camera.z=9', '--set', 'camera.pitch=1', *FROM_TF]


def transform(parent, child, xyz, rotation):
    names = [dict(zip('xyzw', values, strict=False)) for values in (xyz, rotation)]
    return make(
        'geometry_msgs/msg/TransformStamped', header=make_header(0, parent), child_frame_id=child,
        transform=make('geometry_msgs/msg/Transform',
                       translation=make('geometry_msgs/msg/Vector3', **names[0]),
                       rotation=make('geometry_msgs/msg/Quaternion', **names[1])),
    )


def without_tf(drive, path):
    return rewritten(path, [m for m in recorded(drive) if m[0] != '/tf_static'])


def with_tf(drive, path, base='base_link'):
    """The drive with its camera in /tf_static, by two transforms, and an invalid one."""
    messages = [m for m in recorded(drive) if m[0] != '/tf_static']
    held = load_parameter_file(drive / 'params.yaml').camera
    place = Extrinsics(held.x, held.y, held.z, held.roll, held.pitch, held.yaw)
    frame = next(jazzy().deserialize_cdr(raw, kind).header.frame_id
                 for _, kind, _, raw in messages if kind == IMAGE)
    mast = transform(base, 'mast', (0.4, 0.0, 0.9), (0.0, 0.0, 0.0, 1.0))
    camera = transform('mast', frame, (held.x - 0.4, held.y, held.z - 0.9),
                       Rotation.from_matrix(place.rotation()).as_quat())
    broken = transform('mast', 'lidar', (0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0))
    tree = make(TF, transforms=[broken, camera, mast])
    last = messages[-1][2]
    return rewritten(path, [*messages, ('/tf_static', TF, last, jazzy().serialize_cdr(tree, TF))])


def test_replay_takes_the_camera_from_the_bag(drive, whole, tmp_path, capsys):
    bag = with_tf(drive, tmp_path / 'tf.mcap')
    _, given = whole
    found = replayed(bag, drive, tmp_path / 'found', *ELSEWHERE)
    assert found['rmse_xy_m'] == pytest.approx(given['rmse_xy_m'], abs=1e-5)
    assert found['published'] == given['published']
    assert 'is taken from /tf_static' in capsys.readouterr().err
    used = load_parameter_file(tmp_path / 'found' / 'params.yaml').camera
    assert used.z == pytest.approx(1.5, abs=1e-6)


@pytest.mark.parametrize('verb', ['replay', 'map', 'check-calibration'])
def test_without_the_transform_every_verb_refuses_by_name(drive, tmp_path, capsys, verb):
    bags = [without_tf(drive, tmp_path / 'none.mcap'),
            with_tf(drive, tmp_path / 'other.mcap', base='chassis')]
    options = ['--map', str(drive / 'map.yaml')] if verb == 'replay' else []
    for bag in bags:
        suffix = {'replay': '', 'map': '.yaml', 'check-calibration': '.png'}[verb]
        out = tmp_path / f'out{suffix}'
        words = [verb, str(bag), '--params', str(drive / 'params.yaml'), *ELSEWHERE, *options]
        assert main([*words, '--out', str(out)]) == 1
        printed = capsys.readouterr().err
        assert 'camera.from_tf is true, and /tf_static of the bag does not hold' in printed
        assert 'set camera.from_tf=false' in printed


@pytest.mark.parametrize('verb', ['map', 'check-calibration'])
def test_the_other_verbs_take_it_too_and_refuse_a_mask_topic(drive, tmp_path, capsys, verb):
    bag = with_tf(drive, tmp_path / 'tf.mcap')
    out = tmp_path / ('map.yaml' if verb == 'map' else 'check.png')
    options = ['--no-pose-check'] if verb == 'map' else []
    words = [verb, str(bag), '--params', str(drive / 'params.yaml'), *ELSEWHERE, *options,
             '--out', str(out)]
    main(words)
    assert 'is taken from /tf_static: x ' in capsys.readouterr().err
    assert out.exists()
    assert main([*words, '--force', '--set', 'mask.from_topic=true']) == 1
    assert 'mask.from_topic: is true, and this verb' in capsys.readouterr().err


def test_parameters_of_the_node_alone_are_named(drive, tmp_path, capsys):
    replayed(drive, drive, tmp_path / 'out', '--duration', '0.3', '--set', 'lifecycle=true',
             '--set', 'state_file=~/pose.json')
    assert 'only by the node: lifecycle, state_file' in capsys.readouterr().err
