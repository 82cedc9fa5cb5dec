# SPDX-FileCopyrightText: gip_localizer contributors
# SPDX-License-Identifier: Apache-2.0
"""`gip calibrate`: the mounting pose of the camera from a drive with known poses on a map."""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from gip_localizer.cli.known_poses import add_pose_options, known_poses
from gip_localizer.parameters.yaml_files import user_path

if TYPE_CHECKING:
    from gip_localizer.mapping.mount_calibration import MountCalibration, MountResult

DEFAULT_OUT = Path('results/calibration')
FRAMES = 40
"""Number of frames; chosen: their mean is good to a hundredth of a degree."""
EXAMPLES = """examples:
  gip calibrate drive --map road.yaml                    start from camera.* of drive/params.yaml
  gip calibrate drive --map road.yaml --set camera.z=1.5 --set camera.pitch=0.26
  gip calibrate drive --map road.yaml --poses rtk.tum --fix z    the height is measured
  gip replay drive --map road.yaml --params results/calibration/params.yaml

The start may be 3 degrees and 0.1 m off. The folder holds params.yaml, calibration.json (with the
covariance), static_transform.sh, and before.png and after.png: the outlines of the map in a
frame.
"""


def add_parser(verbs: Any) -> None:
    """Add the verb to the parser of `gip`."""
    parser = verbs.add_parser(
        'calibrate', help='mounting pose of the camera from a drive with known poses on a map',
        epilog=EXAMPLES, formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Estimate x, y, z, roll, pitch and yaw of the camera in base_link: frames\n'
                    'of a drive are matched with a map, and compared with their known poses.',
    )
    parser.add_argument('bag', nargs='+', type=user_path, metavar='BAG',
                        help='rosbag2 folder, .mcap or .db3 file')
    parser.add_argument('--map', type=user_path, metavar='YAML',
                        help='map (default: map_file of the parameters, or map.yaml next to the '
                             'bag)')
    parser.add_argument('--params', type=user_path, metavar='FILE',
                        help='ROS parameter YAML (default: params.yaml next to the bag, if any)')
    parser.add_argument('--set', action='append', default=[], metavar='NAME=VALUE',
                        dest='settings', help='one parameter, e.g. camera.pitch=0.26; repeatable')
    parser.add_argument('--fix', action='append', default=[], metavar='NAME',
                        choices=('x', 'y', 'z', 'roll', 'pitch', 'yaw'),
                        help='keep x, y, z, roll, pitch or yaw as given; repeatable')
    parser.add_argument('--frames', type=int, default=FRAMES, metavar='N',
                        help=f'number of frames, spread over the drive (default: {FRAMES})')
    add_pose_options(parser)
    parser.add_argument('--image-topic', metavar='TOPIC')
    parser.add_argument('--camera-info-topic', metavar='TOPIC')
    parser.add_argument('--out', type=user_path, default=DEFAULT_OUT, metavar='DIR',
                        help=f'folder to write (default: {DEFAULT_OUT})')
    parser.add_argument('--force', action='store_true', help='replace an earlier calibration')
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Calibrate, write the folder, print the table."""
    from gip_localizer.cli.calibration_folder import (
        calibration_table,
        check_calibration_folder,
        write_calibration,
    )
    from gip_localizer.cli.settings import (
        ctrl_c,
        file_next_to,
        recorded_parameters,
        unused_at_the_desk,
        without_masks,
    )
    from gip_localizer.errors import MapError, ParameterError
    from gip_localizer.io.bags.bag import Bag
    from gip_localizer.io.bags.camera import mounted, recorded_camera
    from gip_localizer.io.map_files import load_map
    from gip_localizer.mapping.known_frames import known_frames
    from gip_localizer.mapping.mount_calibration import LEAST_FRAMES, MountCalibration

    if args.frames < LEAST_FRAMES:
        raise ParameterError(f'--frames {args.frames}: expected at least {LEAST_FRAMES}')
    check_calibration_folder(args.out, force=args.force)
    parameters = recorded_parameters(args)
    path = args.map or parameters.map_file or file_next_to(args.bag, 'map.yaml')
    if not path:
        raise MapError('no map: give one with --map (gip map builds one from a drive)')
    raster_map, bag = load_map(path), Bag(args.bag)
    topics, poses, notes = known_poses(args, bag, parameters, 'calibrate')
    parameters, said = mounted(bag, topics, without_masks(parameters))
    for note in [*notes, *said, *unused_at_the_desk(parameters), *bag.notes]:
        print(f'gip: {note}', file=sys.stderr)
    camera = recorded_camera(bag, topics, parameters)
    frames = known_frames(bag, topics, poses, args.frames)
    calibration = MountCalibration(frames, camera, raster_map, parameters, args.fix)
    with ctrl_c(interrupts=True):
        found = _with_progress(calibration)
    write_calibration(args.out, found, frames, camera, raster_map, parameters, force=args.force)
    print(calibration_table(found, camera.extrinsics, args.fix))
    print(f'\ncalibration: {args.out}')
    return 0


def _with_progress(calibration: MountCalibration) -> MountResult:
    from gip_localizer.cli.progress import progress

    with progress(calibration.steps, 'calibrating') as bar:
        return calibration.run(bar.update)
