# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip import`: make a bag and a parameter file of a folder of images."""

from __future__ import annotations

import argparse
from pathlib import Path
import re
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.io.camera_info_files import CameraInfo
    from gip_localizer.io.folder.images import ImageFolder
    from gip_localizer.parameters import Parameters

DEFAULT_OUT = Path('results/imported')
MARK = 'metadata.yaml'
CALIBRATIONS = ('camera_info.yaml', 'camera.yaml', 'calibration.yaml', 'ost.yaml')
MODELS = ('plumb_bob', 'rational_polynomial', 'equidistant')
"""Distortion models of --model; the first one is the default."""
POSE = ('x', 'y', 'z', 'roll', 'pitch', 'yaw')
EXAMPLES = """examples:
  gip import drive --camera-pose 1.2,0,1.5,0,0.26,0 --out bag   drive/ holds all of it
  gip import frames --rate 10 --k 450,450,319.5,179.5 --set camera.z=0.35 --set camera.pitch=0.4
  gip import 00 --images image_0 --k 718.9,718.9,607.2,185.2 --poses poses/00.txt \\
    --camera-pose 0,0,1.65,0,0.017,0                            KITTI odometry

In FOLDER are found: the images (or in one folder of it), times.txt, timestamps.txt, data.csv or
rgb.txt (one line per image), camera_info.yaml or camera.yaml, poses.txt or groundtruth.txt.
Then: gip map BAG --out map.yaml (a map from the poses), gip replay BAG --map map.yaml
"""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'import', help='make a bag of a folder of images, without ROS', epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Write a rosbag2 folder (MCAP) of the images, with params.yaml.',
    )
    # A pose that begins with a minus sign is a value, not an option.
    parser._negative_number_matcher = re.compile(r'^-[\d.].*$')
    parser.add_argument('folder', type=user_path, metavar='FOLDER')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'folder to write (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace an existing bag in --out')
    images = parser.add_argument_group('images')
    images.add_argument('--images', type=user_path, metavar='DIR', help='the folder of the images')
    images.add_argument('--timestamps', type=user_path, metavar='FILE',
                        help='one line per image: stamp, and optionally its name')
    images.add_argument('--rate', type=float, metavar='HZ', help='images per second, if there are '
                        'no timestamps')
    camera = parser.add_argument_group('calibration and mounting of the camera')
    camera.add_argument('--camera-info', type=user_path, metavar='YAML',
                        help='as camera_calibration writes it, or a CameraInfo message')
    camera.add_argument('--k', metavar='FX,FY,CX,CY', help='camera matrix, pixels')
    camera.add_argument('--d', metavar='D1,D2,...', help='distortion (default: none)')
    camera.add_argument('--model', metavar='NAME', help='distortion model of --k: '
                        'plumb_bob, rational_polynomial or equidistant (default: plumb_bob)')
    camera.add_argument('--camera-pose', metavar='X,Y,Z,ROLL,PITCH,YAW',
                        help='in base_link, metres and radians; z above the road, pitch positive '
                             'when it looks down')
    poses = parser.add_argument_group('ground truth')
    poses.add_argument('--poses', type=user_path, metavar='FILE', help='TUM or KITTI file')
    poses.add_argument('--poses-of', choices=('base', 'camera'),
                       help='whose poses they are (default: base in TUM files, the camera\'s '
                            'optical frame in KITTI files)')
    tune = parser.add_argument_group('parameters')
    tune.add_argument('--params', type=user_path, metavar='FILE', help='ROS parameter YAML')
    tune.add_argument('--set', action='append', default=[], metavar='NAME=VALUE', dest='settings',
                      help='one parameter; repeatable, e.g. --set birdseye.far=15')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read everything, write the bag folder."""
    from gip_localizer.cli.progress import progress
    from gip_localizer.core.camera.extrinsics import Extrinsics
    from gip_localizer.io.folder.drive import FolderDrive
    from gip_localizer.io.folder.images import find_images
    from gip_localizer.io.folder.poses import NAMES, read_poses
    from gip_localizer.io.output_folder import check_folder, fresh_folder

    check_folder(args.out, force=args.force, mark=MARK)
    images = find_images(args.folder, images=args.images, stamps=args.timestamps, rate=args.rate)
    parameters, info = _parameters(args), _camera_info(args, images)
    held = Extrinsics(**{name: getattr(parameters.camera, name) for name in POSE})
    stamps = [stamp for stamp, _ in images.images]
    file = args.poses or _found(args.folder, NAMES)
    poses = None if file is None else read_poses(file, stamps, held, args.poses_of)
    drive = FolderDrive(images, info, parameters, poses)
    with (
        fresh_folder(args.out, force=args.force, mark=MARK) as folder,
        progress(len(images), 'importing', unit='image') as bar,
    ):
        drive.write(folder, bar.update)
    for note in drive.notes:
        print(f'gip: {note}', file=sys.stderr)
    size = sum(path.stat().st_size for path in args.out.iterdir())
    print(f'{args.out}: {len(images)} images, {size / 1e6:.1f} MB; localize it with: gip replay '
          f'{args.out} --map MAP.yaml')
    return 0


def _found(folder: Path, names: tuple[str, ...]) -> Path | None:
    return next((folder / name for name in names if (folder / name).is_file()), None)


def _parameters(args: argparse.Namespace) -> Parameters:
    from gip_localizer.cli.settings import parse_settings
    from gip_localizer.errors import ParameterError
    from gip_localizer.parameters import load_parameter_file, Parameters

    given = load_parameter_file(args.params) if args.params is not None else Parameters()
    settings = parse_settings(args.settings, Parameters)
    if args.camera_pose is not None:
        numbers = _numbers('--camera-pose', args.camera_pose, len(POSE))
        given = given.replace({f'camera.{name}': value
                               for name, value in zip(POSE, numbers, strict=True)})
    elif args.params is None and not {'camera.z', 'camera.pitch'} <= set(settings):
        raise ParameterError(
            'where the camera is mounted is missing: give --camera-pose X,Y,Z,ROLL,PITCH,YAW '
            '(metres, radians; z above the road, pitch positive when it looks down), --params, or '
            '--set camera.z=... and --set camera.pitch=...'
        )
    return given.replace(settings)


def _camera_info(args: argparse.Namespace, images: ImageFolder) -> CameraInfo:
    """Return the calibration of --k, or of a file (raises CalibrationError)."""
    import numpy as np

    from gip_localizer.errors import CalibrationError
    from gip_localizer.io.camera_info_files import CameraInfo, load_camera_info

    if args.k is not None:
        if args.camera_info is not None:
            raise CalibrationError('--k and --camera-info contradict each other; give one of them')
        fx, fy, cx, cy = _numbers('--k', args.k, 4)
        D = _numbers('--d', args.d) if args.d is not None else []
        height, width = next(images.pictures())[1].shape
        K = np.array([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0])
        return CameraInfo(width, height, K, np.array(D), _model(args.model))
    if args.d is not None:
        raise CalibrationError('--d goes with --k; D of --camera-info is in its file')
    if args.model is not None:
        raise CalibrationError('--model goes with --k; the model of --camera-info is in its file')
    file = args.camera_info or _found(args.folder, CALIBRATIONS) or _found(
        images.folder, CALIBRATIONS)
    if file is None:
        raise CalibrationError(
            f'the calibration of the camera is missing: {args.folder} holds none of '
            f'{", ".join(CALIBRATIONS)}; give --camera-info YAML, or --k FX,FY,CX,CY and --d'
        )
    return load_camera_info(file)


def _model(name: str | None) -> str:
    from gip_localizer.errors import CalibrationError

    if name not in (None, *MODELS):
        raise CalibrationError(f'--model {name}: expected {", ".join(MODELS)}')
    return name or MODELS[0]


def _numbers(option: str, text: str, count: int | None = None) -> list[float]:
    from gip_localizer.errors import ParameterError

    try:
        numbers = [float(word) for word in text.split(',')]
    except ValueError:
        numbers = []
    if not numbers or (count is not None and len(numbers) != count):
        how_many = f'{count} numbers' if count is not None else 'numbers'
        raise ParameterError(f'{option} {text}: expected {how_many} separated by commas')
    return numbers
